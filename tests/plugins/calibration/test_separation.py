"""Error separation with dip and magnetic north unknown."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lodeflow_plugins.calibration import chu2017, separation

EULER = [[h, p, r] for h in range(0, 360, 60) for p in (-50, 20, 60) for r in (-40, 40)]
ATTITUDE = Rotation.from_euler("ZYX", EULER, degrees=True).as_matrix()


def readings(azimuth, dip, noise=0.0, seed=0, attitude=ATTITUDE):
    field = np.einsum("nji,j->ni", attitude, separation.direction(azimuth, dip))
    return chu2017.MAGNETOMETER(field) + np.random.default_rng(seed).normal(0, noise, field.shape)


@pytest.mark.parametrize("azimuth", [0.0, 0.4, 2.9, -3.1])
@pytest.mark.parametrize("dip", [-1.1, 0.0, 0.84])
def test_dip_and_north_are_found_exactly(azimuth, dip):
    found = separation.separate(readings(azimuth, dip), ATTITUDE, None)
    assert found.azimuth == pytest.approx(azimuth, abs=1e-9)
    assert found.dip == pytest.approx(dip, abs=1e-9)
    np.testing.assert_allclose(found.fit.bias, chu2017.MAGNETOMETER_BIAS, atol=1e-6)
    np.testing.assert_allclose(found.fit.misalignment, chu2017.MAGNETOMETER_MISALIGNMENT, atol=1e-7)


def test_a_given_dip_is_taken():
    found = separation.separate(readings(0.0, 0.8), ATTITUDE, 0.8)
    assert (found.azimuth, found.dip) == (0.0, 0.8)
    assert np.isnan(found.dip_error)
    assert np.abs(found.residuals).max() < 1e-9


def test_a_wrong_dip_shows_in_the_residuals():
    found = separation.separate(readings(0.0, 0.8), ATTITUDE, 0.75)
    assert found.fit.residual_rms.max() > 10.0


def test_standard_errors_are_those_of_repeated_fits():
    runs = [separation.separate(readings(0.3, 0.8, 2.0, s), ATTITUDE, None) for s in range(80)]
    angles = np.std([[run.azimuth, run.dip] for run in runs], axis=0)
    np.testing.assert_allclose([runs[0].azimuth_error, runs[0].dip_error], angles, rtol=0.35)
    known = [separation.separate(readings(0.0, 0.8, 2.0, s), ATTITUDE, 0.8).fit for s in range(80)]
    for name in ("sensitivity", "bias"):
        spread = np.std([getattr(fit, name) for fit in known], axis=0)
        np.testing.assert_allclose(getattr(known[0], f"{name}_error"), spread, rtol=0.35)
    mean = np.mean([fit.misalignment for fit in known], axis=0)
    off = [np.linalg.norm(fit.misalignment - mean, axis=1) for fit in known]
    spread = np.sqrt(np.mean(np.square(off), axis=0))
    np.testing.assert_allclose(known[0].direction_error, spread, rtol=0.35)


def test_what_does_not_tell_the_angles_is_refused():
    with pytest.raises(ValueError, match="8 positions; at least 10"):
        separation.separate(readings(0.0, 0.8)[:8], ATTITUDE[:8], None)
    one_axis = Rotation.from_euler("Z", np.arange(0, 360, 20)[:, None], degrees=True).as_matrix()
    with pytest.raises(ValueError, match="do not tell dip and magnetic north"):
        separation.separate(readings(0.0, 0.8, attitude=one_axis), one_axis, None)
