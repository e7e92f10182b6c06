"""What of a message can be drawn: numbers by name, each with the unit that people read."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lodeflow.messages.fields import FieldSpec
from lodeflow.messages.message import Message
from lodeflow.messages.units import Radian, RadPerSecond, Tesla, Unit
from lodeflow.recording.columns import components

Values = NDArray[np.float64]

SHOWN: Mapping[type[Unit], tuple[str, float]] = {
    Radian: ("°", 180.0 / math.pi),
    RadPerSecond: ("°/s", 180.0 / math.pi),
    Tesla: ("µT", 1e6),
}
"""Units that people read, with the factor from the SI unit; other quantities stay as they are."""

EULER = ("heading", "pitch", "roll")
"""Quantities that any field with a quaternion has beside its own components."""


@dataclass(frozen=True, eq=False)
class Quantity:
    """One number of each message of a type.

    Attributes:
        field: what it is called without its component; quantities of equal field and unit are
            drawn together.
        component: "x", or "" for a scalar.
        unit: symbol of the unit in which it is shown.
        take: gives its values in a block of N messages, shape (N,), in that unit.
        whole: it counts, and is drawn as steps.
        turn: a difference above half of this is no motion but the end of a turn; 0 for none.
        modes: names of its values, of a mode.
    """

    field: str
    component: str
    unit: str
    take: Callable[[Message], Values]
    whole: bool = False
    turn: float = 0.0
    modes: Mapping[int, str] = dataclasses.field(default_factory=dict)

    @property
    def name(self) -> str:
        """As written behind the name of a stream: "angular_velocity.x"."""
        return f"{self.field}.{self.component}" if self.component else self.field


def quantities(kind: type[Message], *, si: bool = False) -> list[Quantity]:
    """Return all that can be drawn of a type: the components of its fields, then Euler angles.

    Args:
        kind: a type of messages.
        si: show SI units, radian and tesla, not degrees and microtesla.
    """
    found = []
    for spec in kind.fields:
        for place, name in enumerate(components(spec)):
            found.append(_component(kind, spec, place, name.removeprefix(spec.name)[1:], si))
    for spec in kind.fields:
        if spec.ros == "geometry_msgs/Quaternion":
            found += [_angle(spec, name, si) for name in EULER if name not in kind.field_names]
            break
    return found


def _angle(spec: FieldSpec, name: str, si: bool) -> Quantity:
    symbol, factor = ("rad", 1.0) if si else SHOWN[Radian]

    def take(block: Message) -> Values:
        return factor * euler(getattr(block, spec.name))[EULER.index(name)]

    return Quantity(name, "", symbol, take, turn=factor * 2 * math.pi)


def _component(
    kind: type[Message], spec: FieldSpec, place: int, component: str, si: bool
) -> Quantity:
    symbol, factor = (
        (spec.unit.symbol, 1.0) if si else SHOWN.get(spec.unit, (spec.unit.symbol, 1.0))
    )

    def take(block: Message) -> Values:
        column: Any = getattr(block, spec.name)
        values: Values = column.reshape(len(block), -1)[:, place].astype(np.float64)
        return values if factor == 1.0 else values * factor

    found = Quantity(spec.name, component, symbol, take, whole=spec.integer)
    if spec.unit is Radian:
        return replace(found, turn=factor * 2 * math.pi)
    return replace(found, modes=_modes(kind, spec)) if spec.ros == "uint8" else found


def _modes(kind: type[Message], spec: FieldSpec) -> Mapping[int, str]:
    """Return the names of a code: the constants of its type, or those that begin like the field."""
    own = {n: v for n, v in kind.constants.items() if n.startswith(f"{spec.name.upper()}_")}
    codes = [field.name for field in kind.fields if field.ros == "uint8"]
    chosen = own or (kind.constants if len(codes) == 1 else {})
    return {
        value: name.removeprefix(f"{spec.name.upper()}_").lower().replace("_", " ")
        for name, value in chosen.items()
    }


def euler(quaternion: NDArray[np.float64]) -> tuple[Values, Values, Values]:
    """Return heading, pitch and roll of attitudes, in rad.

    Args:
        quaternion: (N, 4), x, y, z, w; rotates body vectors (x forward, y left, z up) into the
            earth frame (x magnetic east, y magnetic north, z up); of any length.

    Returns:
        Heading clockwise from magnetic north, from 0 up to 2 pi; pitch nose up; roll right side
        down; each (N,). NaN where the quaternion is.
    """
    x, y, z, w = quaternion.T
    norm = x * x + y * y + z * z + w * w
    east, north, up = norm - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)
    heading = np.mod(np.arctan2(east, north), 2 * math.pi)
    pitch = np.arctan2(up, np.hypot(east, north))
    roll = np.arctan2(2 * (y * z + w * x), norm - 2 * (x * x + y * y))
    return heading, pitch, roll
