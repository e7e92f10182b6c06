"""Allan deviation: against its definition, and noises of known size."""

import numpy as np
import pytest

from lodeflow_plugins.calibration import allan

RATE = 100.0


def by_definition(signal, size):
    """Overlapping: half the mean square of differences of neighbouring means."""
    means = np.convolve(signal, np.ones(size) / size, "valid")
    return np.sqrt(0.5 * np.mean((means[size:] - means[:-size]) ** 2))


def test_it_is_the_overlapping_allan_deviation():
    signal = np.random.default_rng(0).normal(5.0, 1.0, 3000)
    found = allan.analyse(signal, RATE)
    sizes = allan.cluster_sizes(len(signal))
    np.testing.assert_allclose(found.tau, sizes / RATE)
    expected = [by_definition(signal, size) for size in sizes]
    np.testing.assert_allclose(found.deviation, expected, rtol=1e-9)


def test_white_noise_alone():
    for seed in range(5):
        found = allan.analyse(np.random.default_rng(seed).normal(0.0, 0.02, 100_000), RATE)
        q, n, b, k = found.coefficients
        assert n == pytest.approx(0.02 / 10.0, rel=0.02)
        assert np.isnan([q, b, k]).all()
        assert abs(n - 0.002) < 5 * found.errors[1]


def test_white_noise_and_a_random_walk():
    rng = np.random.default_rng(3)
    walk = np.cumsum(rng.normal(0.0, 1e-4, 200_000))  # 1e-3 per square root of a second
    found = allan.analyse(rng.normal(0.0, 0.02, 200_000) + walk, RATE)
    assert found.coefficients[1] == pytest.approx(2e-3, rel=0.03)
    assert found.coefficients[3] == pytest.approx(1e-3, rel=0.3)


def test_rounding_is_quantization_noise():
    # A slow ramp across many steps: the error of rounding is white in angle, not in rate.
    angle = np.random.default_rng(1).uniform(-0.5, 0.5, 50_001)
    found = allan.analyse(np.diff(angle) * RATE, RATE)
    assert found.coefficients[0] == pytest.approx(1.0 / np.sqrt(12.0), rel=0.1)
    assert np.isnan(found.coefficients[2:]).all()


@pytest.mark.parametrize(
    ("signal", "why"), [(np.zeros(199), "199 samples"), (np.ones(500), "never changes")]
)
def test_what_tells_nothing_is_refused(signal, why):
    with pytest.raises(ValueError, match=why):
        allan.analyse(signal, RATE)
