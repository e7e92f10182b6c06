"""What the filter reaches on six trials of BROAD, in the folder that LODEFLOW_DATA names."""

import os
from pathlib import Path

import pytest

DATA = os.environ.get("LODEFLOW_DATA")
needs_data = pytest.mark.skipif(
    DATA is None, reason="LODEFLOW_DATA does not name a folder with broad/"
)

# Total, heading and inclination RMSE in degrees, without the gate and with it at 0.5 m/s^2.
FIGURES = {
    "02_undisturbed_slow_rotation_B": ((2.34, 1.63, 1.67), (2.55, 1.63, 1.97)),
    "18_undisturbed_fast_translation_with_breaks_B": ((34.46, 13.81, 31.69), (9.75, 4.02, 8.88)),
    "25_disturbed_tapping_B": ((6.09, 3.65, 4.88), (10.78, 6.88, 8.30)),
    "27_disturbed_phone_vibration_B": ((12.09, 3.81, 11.47), (18.95, 6.28, 17.89)),
    "31_disturbed_stationary_magnet_D": ((18.44, 4.32, 17.93), (7.73, 3.04, 7.11)),
    "34_disturbed_attached_magnet_3cm": ((7.27, 6.86, 2.42), (5.61, 5.31, 1.81)),
}


def path_of(trial):
    return Path(DATA) / "broad" / f"{trial}.mat"
