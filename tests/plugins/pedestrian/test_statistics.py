"""The detectors' statistics, against numpy over each window."""

import numpy as np
import pytest

from lodeflow_plugins.pedestrian.zero_velocity import statistics

G, SIGMA_A, SIGMA_W, WINDOW = 9.81, 0.01, 0.00175, 5


def expected(kind, force, rate):
    mean = force.mean(axis=0)
    match kind:
        case statistics.SHOE:
            rest = force - G * mean / np.linalg.norm(mean)
            terms = (rest**2).sum(1) / SIGMA_A**2 + (rate**2).sum(1) / SIGMA_W**2
        case statistics.ARED:
            terms = (rate**2).sum(1)
        case statistics.AMVD:
            terms = ((force - mean) ** 2).sum(1)
        case statistics.MAG:
            terms = (np.linalg.norm(force, axis=1) - G) ** 2
    return terms.mean()


@pytest.mark.parametrize(
    "kind", [statistics.SHOE, statistics.ARED, statistics.AMVD, statistics.MAG]
)
def test_statistic(kind):
    rng = np.random.default_rng(kind)
    force = rng.standard_normal((40, 3)) + np.array([0, 0, G])
    rate = rng.standard_normal((40, 3))
    out = np.empty(40)
    state = statistics.new_state(WINDOW)
    statistics.statistic(kind, force, rate, np.array([G, SIGMA_A, SIGMA_W]), state, out)
    assert np.isinf(out[: WINDOW - 1]).all()
    for k in range(WINDOW - 1, 40):
        window = slice(k - WINDOW + 1, k + 1)
        assert out[k] == pytest.approx(expected(kind, force[window], rate[window]), rel=1e-12)
