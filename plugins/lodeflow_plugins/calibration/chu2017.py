"""The sensor constants of Chu et al. 2017, in the paper's own frames and units.

Source: Magnetic orientation system based on magnetometer, accelerometer and gyroscope, CAAI
Transactions on Intelligence Technology 2(4):301-310, section 3. Two entries of Table 1 cannot be
right as printed, and are corrected here; all else is as printed.

Magnetometer: h^b in FRD, in units of the earth field's strength H_e. Accelerometer: A^b in FLU, in
g. Gyroscope: w^b in FRD. The paper gives no unit of w^b; 8.04 LSB per unit suits a common range of
+-250 degrees per second in 12 bits. Its chip reads x backward, y right and z up, as the
accelerometer's does, which is what makes w^b FRD.
"""

import numpy as np

from lodeflow_plugins.calibration import error_models

MAGNETOMETER_SENSITIVITY = np.array([1751.15, 1720.05, 1717.16])
"""K of Eq. 6, LSB per H_e (section 3.1)."""

MAGNETOMETER_BIAS = np.array([61.93, -114.52, -183.77])
"""b of Eq. 6, LSB (section 3.1)."""

TABLE_1_AS_PRINTED = np.array(
    [[0.0640, 89.8353, 89.4179], [88.8302, 1.9147, 91.5156], [90.8175, 90.8175, 3.0661]]
)
"""Table 1 in degrees: angle of the sensor axes x, y, z (rows) to the body axes x, y, z."""


def _completing(first: float, second: float) -> float:
    """The angle below 90 degrees that completes two direction angles to those of a unit vector."""
    cosines = np.cos(np.radians([first, second]))
    return float(np.degrees(np.arccos(np.sqrt(1.0 - cosines @ cosines))))


TABLE_1 = TABLE_1_AS_PRINTED.copy()
"""Table 1 in degrees, corrected so that the cosines of each row make a unit vector.

- Row x: the printed 0.0640 gives a squared norm of 1.00011. The other two angles ask for 0.6050
  (two digits of the print are swapped).
- Row z: the squared norm is 0.99755, so one of the two equal angles 90.8175 is a misprint, and its
  place asks for 87.0451 or 92.9549. Angle z_m y_b = 87.0451 leaves the sensor axes nearest to
  orthogonal (90.23 and 88.58 degrees from z to x and y), so it is taken. This choice is an
  inference; a wrong one costs at most 0.11 degrees of heading when level, but 5 to 8 at 60 degrees
  of pitch and roll.
"""
TABLE_1[0, 0] = _completing(TABLE_1[0, 1], TABLE_1[0, 2])
TABLE_1[2, 1] = _completing(TABLE_1[2, 0], TABLE_1[2, 2])

MAGNETOMETER_MISALIGNMENT = np.cos(np.radians(TABLE_1))
"""M of Eq. 6: each row is a sensor axis in the body frame."""

SIX_POSITIONS = np.array(
    [
        [0.0, 0.0, 1.0],  # z down
        [0.0, 0.0, -1.0],  # z up
        [0.0, 1.0, 0.0],  # y down
        [0.0, -1.0, 0.0],  # y up
        [-1.0, 0.0, 0.0],  # x down
        [1.0, 0.0, 0.0],  # x up
    ]
)
"""Table 2: A^b in g at rest, by the FRD axis that points down or up."""

ACCELEROMETER_GAIN = np.array(
    [
        [-0.0001773, 0.0000016, 0.0000016],
        [0.0000037, -0.0001800, -0.0000007],
        [0.0000036, -0.0000004, 0.0001801],
    ]
)
"""A of Eq. 8, g per LSB (Table 3)."""

ACCELEROMETER_OFFSET = np.array([-0.0155254, 0.0227611, -0.0048272])
"""A0 of Eq. 8, g (Table 3)."""

GYROSCOPE_K = np.array(
    [
        [-0.1243681, -0.0012937, -0.0033316],
        [0.0003576, 0.1237108, 0.0009321],
        [0.0003312, -0.0001178, -0.1243840],
        [-2.3843363, 2.3942377, -2.1203979],
    ]
)
"""K of Eq. 17; three rows of transposed gain per LSB, one row of bias."""

MAGNETOMETER = error_models.magnetometer(
    MAGNETOMETER_SENSITIVITY, MAGNETOMETER_MISALIGNMENT, MAGNETOMETER_BIAS
)
"""h^b -> raw, Eq. 6."""

ACCELEROMETER = error_models.accelerometer(ACCELEROMETER_GAIN, ACCELEROMETER_OFFSET)
"""raw -> A^b, Eq. 8."""

GYROSCOPE = error_models.gyroscope(GYROSCOPE_K)
"""raw -> w^b, Eq. 12."""
