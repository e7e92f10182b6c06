"""What the nodes that make a heading have in common, so that one can be swapped for another."""

from typing import NamedTuple

import numpy as np

import lodeflow as lf

TURN = 2.0 * np.pi


class HeadingPorts(NamedTuple):
    """Ports of every node that makes a heading of compasses and gyro."""

    heading: lf.Heading | None
    status: lf.HeadingStatus | None


def full_turns(heading: np.ndarray) -> np.ndarray:
    """The headings (N,) in [0, 2 pi), rad."""
    turned = heading % TURN
    return np.where(turned < TURN, turned, 0.0)  # -1e-17 + 2 pi rounds to a full turn


def rate_to_the_right(gyro: lf.Sparse[lf.AngularRate]) -> np.ndarray:
    """Rate of the heading (M,), rad/s: clockwise from above, where the body's z axis is up."""
    return np.ascontiguousarray(-gyro.values.angular_rate[:, 2])


def no_rows(kind: type[lf.Message]) -> lf.Sparse:
    """An input without rows, to compile a kernel with."""
    return lf.Sparse(kind.empty(), np.empty(0, np.int64), np.empty(0, np.int64))


def at_gyro(
    gyro: lf.Sparse[lf.AngularRate],
    first: int,
    heading: np.ndarray,
    columns: tuple[np.ndarray, ...],
) -> HeadingPorts | None:
    """Messages at the rows from `first` on that have a gyro sample.

    heading: (N,), rad; columns: (N,) each, of `HeadingStatus`.
    """
    rows = first + np.flatnonzero(gyro.rows[first:] >= 0)
    if not len(rows):
        return None
    t = gyro.t[rows]
    status = [np.ascontiguousarray(column[rows]) for column in columns]
    return HeadingPorts(
        lf.Heading(t, full_turns(np.ascontiguousarray(heading[rows]))),
        lf.HeadingStatus(t, *status),
    )
