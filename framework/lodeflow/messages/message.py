"""Message: a typed record with an event-time stamp, as one sample or as a block of columns."""

from __future__ import annotations

import inspect
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

import numpy as np

from lodeflow.errors import MessageError, did_you_mean
from lodeflow.messages.declaration import annotated_names, check_names
from lodeflow.messages.fields import INTEGER_RANGES, FieldSpec, resolve
from lodeflow.messages.ros import definition

M = TypeVar("M", bound="Message")

by_ros_name: dict[str, type[Message]] = {}
"""Every declared message type, under its ROS 2 name."""


class MessageMeta(type):
    """Builds a message type from its annotations: slots, constructor, row and block conversions."""

    def __new__(
        mcls,
        name: str,
        bases: tuple[type, ...],
        namespace: dict[str, Any],
        *,
        ros: str | None = None,
        frame: str = "",
    ) -> MessageMeta:
        """Create the class; `ros` is its ROS 2 name (none for an abstract base)."""
        own = annotated_names(namespace)
        inherited = [f for base in bases for f in getattr(base, "field_names", ())]
        names = (*inherited, *(n for n in own if n not in inherited))
        slots = [n for n in names if n not in inherited]
        check_names(name, slots, bases, namespace)
        if not any(isinstance(base, MessageMeta) for base in bases):
            slots = ["t", *slots]
        namespace = {**namespace, "__slots__": tuple(slots), "field_names": names}
        if ros is not None:
            namespace.update(ros=ros, frame=frame)
        cls = super().__new__(mcls, name, bases, namespace)
        if ros is not None:
            _finish(cls, ros)  # type: ignore[arg-type]
        return cls


class Message(metaclass=MessageMeta):
    """Base of all message types.

    A *sample* has `t` as an int (event time, nanoseconds) and each field in its own shape; a
    *block* has a leading axis N on `t` (int64) and on each field. Both are immutable by
    convention: attributes cannot be assigned, and nodes do not write into arrays they receive.

    Construct with `t` and the fields in the order of their declaration. The constructor does not
    look at its arguments (it is on the path of every message); `validate` does.
    """

    fields: ClassVar[tuple[FieldSpec, ...]] = ()
    field_names: ClassVar[tuple[str, ...]] = ()
    constants: ClassVar[dict[str, int]] = {}
    ros: ClassVar[str] = ""
    ros_defaults: ClassVar[dict[str, Any]] = {}
    """Values of ROS fields that the type does not declare, as "path": number."""
    frame: ClassVar[str] = ""
    """Default frame_id of streams of this type."""

    if TYPE_CHECKING:
        t: Any

        def __init__(self, t: Any, *values: Any, **named: Any) -> None: ...

        def row(self: M, index: int) -> M:
            """Return row `index` of a block as a sample."""

        def as_block(self: M) -> M:
            """Return a sample as a block of one row (views of its arrays)."""

        def values(self) -> tuple[Any, ...]:
            """Return the fields in the order of their declaration, without `t`."""

        def is_well_formed(self) -> bool:
            """Whether a block's columns have type, shape and order; a quick look, True is sure."""

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"{type(self).__name__} is immutable; use replace({name}=...)")

    def __delattr__(self, name: str) -> None:
        raise AttributeError(f"{type(self).__name__} is immutable")

    @property
    def is_block(self) -> bool:
        """Whether this is a block of columns."""
        return isinstance(self.t, np.ndarray)

    def __len__(self) -> int:
        if not self.is_block:
            raise TypeError(f"a sample of {type(self).__name__} has no length; a block has")
        return len(self.t)

    def __bool__(self) -> bool:
        return True  # or `if message:` would ask a sample for its length

    def __getitem__(self: M, key: Any) -> M:
        """Return row `key` as a sample, or the rows that a slice, mask or index array selects."""
        if not self.is_block:
            raise TypeError(f"a sample of {type(self).__name__} has no rows; a block has")
        if isinstance(key, (int, np.integer)):
            return self.row(int(key))
        columns = [column[key] for column in (self.t, *self.values())]
        if isinstance(key, slice) and key.step not in (None, 1):
            columns = [np.ascontiguousarray(column) for column in columns]
        return type(self)(*columns)

    def replace(self: M, **changes: Any) -> M:
        """Return a copy with some fields (or `t`) replaced.

        Raises:
            MessageError: a name is not a field.
        """
        for name in changes:
            if name != "t" and name not in self.field_names:
                near = did_you_mean(name, self.field_names)
                raise MessageError(f"{type(self).__name__} has no field {name!r}{near}")
        values = zip(self.field_names, self.values(), strict=True)
        return type(self)(
            changes.get("t", self.t), *[changes.get(name, value) for name, value in values]
        )

    @classmethod
    def concat(cls: type[M], blocks: Sequence[M]) -> M:
        """Return one block with the rows of `blocks` in order."""
        if len(blocks) == 1:
            return blocks[0]
        if not blocks:
            return cls.empty()
        columns = zip(*[block.values() for block in blocks], strict=True)
        return cls(
            np.concatenate([block.t for block in blocks]),
            *[np.concatenate(column) for column in columns],
        )

    @classmethod
    def stack(cls: type[M], samples: Sequence[M]) -> M:
        """Return one block with a row per sample.

        Raises:
            MessageError: a value does not fit its field without loss.
        """
        if not samples:
            return cls.empty()
        columns = zip(*[sample.values() for sample in samples], strict=True)
        return cls(
            np.array([sample.t for sample in samples], dtype=np.int64),
            *[
                _column(cls, field, column)
                for field, column in zip(cls.fields, columns, strict=True)
            ],
        )

    @classmethod
    def empty(cls: type[M]) -> M:
        """Return a block without rows."""
        return cls(
            np.empty(0, dtype=np.int64),
            *[np.empty((0, *field.shape), dtype=field.dtype) for field in cls.fields],
        )

    @classmethod
    def of(cls: type[M], t: int | np.integer[Any], **values: Any) -> M:
        """Return a validated sample from plain numbers and lists; fields not named are zero.

        Raises:
            MessageError: a name is not a field, or a value does not fit.
        """
        if unknown := [name for name in values if name not in cls.field_names]:
            near = did_you_mean(unknown[0], cls.field_names)
            raise MessageError(f"{cls.__name__} has no field {unknown[0]!r}{near}")
        converted: list[Any] = []
        for field in cls.fields:
            value = values.get(field.name, np.zeros(field.shape, field.dtype))
            try:  # safe: an integer may become a float, but no float is cut to an integer
                array = np.asarray(value).astype(field.dtype, order="C", casting="safe")
            except (TypeError, ValueError):
                what = f"{field.dtype} of shape {field.shape}"
                raise MessageError(
                    f"{cls.__name__}.{field.name}: {value!r} is not {what}"
                ) from None
            converted.append(array if field.shape else array.item() if array.ndim == 0 else array)
        stamp = t.item() if isinstance(t, np.integer) else t
        sample = cls(stamp, *converted)
        sample.validate()
        return sample

    def validate(self) -> None:
        """Check form, types and shapes; finiteness and the order of stamps are not looked at.

        Raises:
            MessageError: names the field, what it should be, and what it is.
        """
        block = self.is_block
        if block and (self.t.dtype != np.int64 or self.t.ndim != 1):
            self._refuse("t", "an int64 array of shape (N,)", self.t)
        if not block and type(self.t) is not int:
            self._refuse("t", "an int in nanoseconds, or an int64 array for a block", self.t)
        for field, value in zip(self.fields, self.values(), strict=True):
            _validate_field(self, field, value, block)

    def _refuse(self, name: str, expected: str, value: Any) -> None:
        got = (
            f"{value.dtype} of shape {value.shape}"
            if isinstance(value, np.ndarray)
            else f"{value!r} ({type(value).__name__})"
        )
        raise MessageError(f"{type(self).__name__}.{name} must be {expected}, got {got}")

    def __eq__(self, other: object) -> bool:
        if type(self) is not type(other) or not isinstance(other, Message):
            return NotImplemented
        if not np.array_equal(self.t, other.t):
            return False
        pairs = zip(self.values(), other.values(), strict=True)
        return all(np.array_equal(a, b, equal_nan=True) for a, b in pairs)

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        name = type(self).__name__
        if self.is_block:
            span = f", t={self.t[0]}..{self.t[-1]}" if len(self.t) else ""
            return f"{name}[{len(self.t)} rows{span}]"
        values = zip(self.field_names, self.values(), strict=True)
        shown = [
            f"{field}={value.tolist() if isinstance(value, np.ndarray) else value}"
            for field, value in values
        ]
        return f"{name}({', '.join([f't={self.t}', *shown])})"

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.t, *self.values())


def _column(cls: type[Message], field: FieldSpec, values: Sequence[Any]) -> Any:
    try:  # safe: an integer may become a float, but no float is cut to an integer
        column = np.array(values).astype(field.dtype, copy=False, casting="safe")
    except (TypeError, ValueError):
        raise MessageError(
            f"{cls.__name__}.{field.name}: not every sample has {field.dtype} of shape "
            f"{field.shape}"
        ) from None
    return column


def _validate_field(message: Message, field: FieldSpec, value: Any, block: bool) -> None:
    memory = "int64" if field.integer else "float64"
    if block or field.shape:
        shape = (len(message.t), *field.shape) if block else field.shape
        ok = isinstance(value, np.ndarray) and value.dtype == field.dtype and value.shape == shape
        if not ok or not value.flags.c_contiguous:
            where = str(field.shape) if not block else f"(N, {', '.join(map(str, field.shape))})"
            where = where if field.shape else "(N,)"
            message._refuse(field.name, f"a C-contiguous {memory} array of shape {where}", value)
    elif field.integer:
        if isinstance(value, bool) or not isinstance(value, (int, np.integer)):
            message._refuse(field.name, "an int", value)
    elif not isinstance(value, (float, np.floating)):
        message._refuse(field.name, "a float", value)
    if field.integer:
        low, high = INTEGER_RANGES[field.ros]
        least = most = value
        if isinstance(value, np.ndarray):
            least, most = value.min(initial=high), value.max(initial=low)
        if least < low or most > high:
            message._refuse(field.name, f"from {low} to {high}", value)


def _finish(cls: type[Message], ros: str) -> None:
    """Resolve the fields of a declared type and generate its fast methods."""
    if known := by_ros_name.get(ros):
        raise MessageError(f"{cls.__name__}: the ROS 2 name {ros!r} is taken by {known.__name__}")
    if not re.fullmatch("[a-z][a-z0-9_]*/msg/[A-Z][A-Za-z0-9]*", ros):
        raise MessageError(f"{cls.__name__}: ros={ros!r} must read package/msg/Name")
    try:
        hints = _hints(cls)
    except (NameError, AttributeError) as error:
        raise MessageError(
            f"{cls.__name__}: {error}; annotations are read when the class is defined"
        ) from None
    cls.fields = tuple(resolve(cls.__name__, name, hints[name]) for name in cls.field_names)
    cls.constants = {
        name: value
        for base in reversed(cls.__mro__)
        for name, value in vars(base).items()
        if name.isupper() and type(value) is int
    }
    for name, value in cls.constants.items():
        if not 0 <= value <= 255:
            raise MessageError(f"{cls.__name__}.{name} must be from 0 to 255, got {value}")
    definition(cls)
    _generate_when_used(cls)
    by_ros_name[ros] = cls


def _hints(cls: type[Message]) -> dict[str, Any]:
    """Return the annotations of a type and its bases; typing would look at Message's own too."""
    found: dict[str, Any] = {}
    for base in reversed(cls.__mro__):
        if issubclass(base, Message) and base is not Message:
            found |= inspect.get_annotations(base, eval_str=True)
    return found


def _generate_when_used(cls: type[Message]) -> None:
    """Generate the methods when the first message is made: a program uses few of the types."""

    def first_made(self: Message, *values: Any, **named: Any) -> None:
        generate(cls)
        cls.__init__(self, *values, **named)

    cls.__init__ = first_made  # type: ignore[method-assign]


def generate(cls: type[Message]) -> None:
    """Write the methods that every message passes through, without loops over fields.

    Whoever makes a message without its constructor calls this before; again does no harm.

    A constructor that goes through `__setattr__` or a loop costs several times as much as one
    that calls the slots' own setters.
    """
    names = ["t", *cls.field_names]
    scalars = {field.name for field in cls.fields if not field.shape} | {"t"}
    row = ", ".join(f"self.{n}.item(index)" if n in scalars else f"self.{n}[index]" for n in names)
    column = {field.name: "float64" if not field.integer else "int64" for field in cls.fields}
    column["t"] = "int64"
    block = ", ".join(
        f"array((self.{n},), {column[n]})" if n in scalars else f"self.{n}[None]" for n in names
    )
    sets = "\n".join(f"    _set_{n}(self, {n})" for n in names)
    everything = "".join(f"self.{n}, " for n in cls.field_names)
    looks = "".join(
        f" and self.{f.name}.dtype is {column[f.name]}"
        f" and self.{f.name}.shape == ({', '.join(['n', *map(str, f.shape), ''])})"
        f" and self.{f.name}.flags.c_contiguous"
        for f in cls.fields
    )
    source = (
        f"def __init__(self, {', '.join(names)}):\n{sets}\n"
        f"def row(self, index):\n    return cls({row})\n"
        f"def as_block(self):\n    return cls({block})\n"
        f"def values(self):\n    return ({everything})\n"
        "def is_well_formed(self):\n    try:\n        n = len(self.t)\n"
        f"        return self.t.dtype is int64 and self.t.shape == (n,){looks}\n"
        "    except (AttributeError, TypeError):\n        return False\n"
    )
    scope: dict[str, Any] = {
        "cls": cls,
        "array": np.array,
        "float64": np.dtype(np.float64),
        "int64": np.dtype(np.int64),
        **{f"_set_{n}": getattr(cls, n).__set__ for n in names},
    }
    exec(compile(source, f"<{cls.__name__}>", "exec"), scope)
    for method in ("__init__", "row", "as_block", "values", "is_well_formed"):
        scope[method].__qualname__ = f"{cls.__qualname__}.{method}"
        setattr(cls, method, scope[method])
