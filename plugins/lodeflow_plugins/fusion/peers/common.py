"""What the wrapped filters have in common: how their inputs meet, and how they begin."""

from typing import Annotated, Any

import numpy as np
from pydantic import Field

import lodeflow as lf


def missing(package: str, error: ImportError) -> lf.NodeError:
    """Return what to raise where a package of the extra `peers` cannot be imported."""
    return lf.NodeError(
        f"this plugin wraps the package {package}, which cannot be imported ({error}); "
        "install lodeflow with its extra: pip install 'lodeflow[peers]'"
    )


def scalar_last(quaternion: np.ndarray) -> np.ndarray:
    """Turn quaternions (..., 4) from w, x, y, z into x, y, z, w."""
    return np.take(np.asarray(quaternion, np.float64), (1, 2, 3, 0), axis=-1)


class Peer(lf.Node):
    """Base: an estimate for each IMU sample, corrected by the magnetometer where it has a reading.

    A reading between two IMU samples counts at the second one.
    """

    sync = lf.Each()

    def start(self) -> None:
        self.field: np.ndarray | None = None

    def step(self, imu: lf.Imu | None, mag: lf.MagneticField | None) -> lf.Attitude | None:
        if mag is not None:
            self.field = mag.magnetic_field
        if imu is None:
            return None
        field, self.field = self.field, None
        quaternion = self.advance(imu, field)
        return None if quaternion is None else lf.Attitude(imu.t, quaternion)

    def advance(self, imu: lf.Imu, field: np.ndarray | None) -> np.ndarray | None:
        """Return the estimate at an IMU sample, x, y, z, w, ENU <- FLU; None before the first.

        imu: a sample; field: (3,), T, FLU, or None where there is no reading.
        """
        raise NotImplementedError


class RateParams(lf.Params):
    """Rate of the samples."""

    rate: Annotated[float | None, lf.Hertz] = Field(None, gt=0)
    """Rate of the IMU, which the filter takes to be constant; null for what the first two stamps
    say."""


class RatedPeer(Peer):
    """Base of filters that must know their rate before the first sample.

    Where only the stamps tell it, the first estimate comes from a filter at rest, for which the
    rate does not matter, and the second sample begins the filter anew with both.
    """

    def start(self) -> None:
        super().start()
        self.first: tuple[lf.Imu, np.ndarray | None] | None = None
        rate = self.params.rate
        self.filter = None if rate is None else self.make(rate)

    def advance(self, imu: lf.Imu, field: np.ndarray | None) -> np.ndarray | None:
        if self.filter is None:
            if self.first is None:
                self.first = imu, field
                at_rest = imu.replace(angular_velocity=np.zeros(3))
                return self.feed(self.make(100.0), at_rest, field)
            before, its_field = self.first
            self.filter = self.make(1e9 / (imu.t - before.t))
            self.feed(self.filter, before, its_field)
        return self.feed(self.filter, imu, field)

    def make(self, rate: float) -> Any:
        """Return a new filter for IMU samples at a rate in Hz."""
        raise NotImplementedError

    def feed(self, wrapped: Any, imu: lf.Imu, field: np.ndarray | None) -> np.ndarray | None:
        """Update a filter, and return its estimate as `advance` does."""
        raise NotImplementedError
