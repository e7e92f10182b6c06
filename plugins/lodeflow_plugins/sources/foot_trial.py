"""Recorded walks with a sensor on the foot, as .npz files.

Columns: t (N,) in s; imu (N, 6), specific force in m/s^2 and angular rate in rad/s; and what is
known of the truth: stride_index (S + 1,), the sample of a stance before and after each of S
strides, or strides_hand, their number alone; vicon_xy (N, 2), an optical position in m.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np

import lodeflow as lf

SIGNS = {"flu": np.array([1.0, 1.0, 1.0]), "frd": np.array([1.0, -1.0, -1.0])}


class Ports(NamedTuple):
    """Ports of `FootTrial`."""

    imu: lf.Imu | None
    truth: lf.StepTruth | None
    position: lf.PositionTruth | None


class FootTrial(lf.Source):
    """One recorded walk: IMU on the foot, counted strides, and an optical position if there is.

    The stamps of a file are those of its arrival and jitter by some ms, while the sensor samples
    evenly; so t counts evenly, from the start of the run, at the mean rate of the file. A
    message of `truth` stands at each stance that ends a stride, and one with count 0 before the
    first; where only the number of strides is known, at the first and last sample. `position`
    has no height; its two axes are a right-handed pair seen from above in either case of
    `body_axes`, with a heading of their own.
    """

    rows: ClassVar[int] = 1000
    """Rows of a block."""

    class Params(lf.Params):
        """Which walk."""

        file: str
        """Path of the .npz file."""
        body_axes: Literal["flu", "frd"] = "frd"
        """Axes of the file: x forward, y left, z up, or y right, z down (rest has z = -9.8). An
        optical position beside the latter has its y axis turned as well."""

    def read(self, clock: lf.Clock) -> Iterator[Ports]:
        data = _load(self.params.file)
        imu = data["imu"]
        count = len(imu)
        spacing = (data["t"][-1] - data["t"][0]) / (count - 1) * 1e9
        t = clock.start + np.rint(np.arange(count) * spacing).astype(np.int64)
        sign = SIGNS[self.params.body_axes]
        force, rate = (
            np.ascontiguousarray(imu[:, :3] * sign),
            np.ascontiguousarray(imu[:, 3:] * sign),
        )
        stances, counts, position = data["stances"], data["counts"], data["position"]
        for first in range(0, count, self.rows):
            part = slice(first, first + self.rows)
            at = slice(*np.searchsorted(stances, [first, first + self.rows]))
            yield Ports(
                lf.Imu(t[part], rate[part], force[part]),
                lf.StepTruth(t[stances[at]], counts[at]),
                None if position is None else lf.PositionTruth(t[part], position[part] * sign),
            )


def _load(file: str) -> dict[str, Any]:
    """The columns as they are sent. Raises ValueError for a file that is no walk."""
    try:
        with np.load(Path(file), allow_pickle=False) as found:
            data = {name: found[name] for name in found.files}
    except Exception as error:  # zip and numpy raise whatever they stumble over
        raise ValueError(f"{file}: cannot be read as an .npz file: {error}") from None
    missing = [name for name in ("t", "imu") if name not in data]
    if "stride_index" not in data and "strides_hand" not in data:
        missing.append("stride_index or strides_hand")
    if missing:
        raise ValueError(f"{file} is no walk: it has no {', '.join(missing)}")
    count = len(data["t"]) if data["t"].ndim == 1 else 0
    shapes = {"imu": (count, 6), "vicon_xy": (count, 2)}
    for name, shape in shapes.items():
        if name in data and data[name].shape != shape:
            raise ValueError(f"{file}: {name} has the shape {data[name].shape}, not {shape}")
    t = data["t"].astype(float)
    if count < 2 or not np.isfinite(t).all() or not t[-1] > t[0]:
        raise ValueError(f"{file}: t should be two or more times in s, the last after the first")
    if "stride_index" in data:
        stances = data["stride_index"].astype(np.int64)
        counts = np.arange(len(stances))
    else:
        stances = np.array([0, count - 1])
        counts = np.array([0, int(data["strides_hand"])])
    if stances.ndim != 1 or (np.diff(stances) <= 0).any() or not (stances >= 0).all():
        raise ValueError(f"{file}: stride_index should be samples that follow each other")
    if len(stances) and stances[-1] >= count:
        raise ValueError(f"{file}: stride_index names sample {stances[-1]} of {count}")
    position = None
    if "vicon_xy" in data:
        position = np.full((count, 3), np.nan)
        position[:, :2] = data["vicon_xy"]
    return {
        "t": t,
        "imu": data["imu"].astype(float),
        "stances": stances,
        "counts": counts.astype(np.int64),
        "position": position,
    }
