"""What the body of a message class declares, and which names it may use."""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from typing import Any, get_origin

from lodeflow.errors import MessageError

RESERVED = frozenset({"t", "self", "header", "row", "as_block", "values", "is_well_formed"})
"""Names that a message type has of itself, beside the attributes of its bases."""


def annotated_names(namespace: dict[str, Any]) -> list[str]:
    """Return the names that a class body annotates, without ClassVars."""
    if sys.version_info >= (3, 14):
        import annotationlib

        annotate = annotationlib.get_annotate_from_class_namespace(namespace)
        found: dict[str, Any] = (
            annotationlib.call_annotate_function(annotate, annotationlib.Format.FORWARDREF)
            if annotate
            else {}
        )
    else:
        found = namespace.get("__annotations__", {})
    return [
        name
        for name, hint in found.items()
        if "ClassVar" not in (hint if isinstance(hint, str) else str(get_origin(hint) or hint))
    ]


def check_names(
    owner: str, fields: Sequence[str], bases: tuple[type, ...], namespace: dict[str, Any]
) -> None:
    """Look at the names of new fields.

    Raises:
        MessageError: ROS 2 or the class itself cannot take a name, or a field has a default.
    """
    taken = RESERVED.union(*[dir(base) for base in bases])
    for field in fields:
        if field in taken:
            raise MessageError(f"{owner}.{field}: a field cannot have this name, it is taken")
        if not re.fullmatch("[a-z][a-z0-9_]*", field):
            raise MessageError(
                f"{owner}.{field}: a field is named in lower case (a-z, 0-9, _); "
                "a constant is annotated as ClassVar"
            )
        if field in namespace:
            raise MessageError(f"{owner}.{field}: a field has no default value")
