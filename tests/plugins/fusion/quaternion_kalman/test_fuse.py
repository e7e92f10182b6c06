"""One call for compass and filter gives the bytes of the two."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lodeflow_plugins.fusion.quaternion_kalman import filter as kalman
from lodeflow_plugins.fusion.quaternion_kalman.fuse import fuse
from lodeflow_plugins.fusion.tilt_compass import compass
from lodeflow_plugins.sources.simulated_vehicle import model

STAMPS = np.arange(200, dtype=np.int64) * 10_000_000
READINGS = model.readings(model.truth(model.Vehicle(), STAMPS * 1e-9), model.Errors(), 0, 0)
RATE, FORCE = READINGS.angular_velocity, READINGS.specific_force
SLOW_FIELD = READINGS.magnetic_field[3::4].copy()  # a magnetometer at a quarter of the rate
ROW = np.where(np.arange(200) % 4 == 3, np.arange(200) // 4, -1)
CONSTANTS = kalman.constants(0.003, 1e-3, 1e-3)


def in_two_steps(tolerance):
    norm = np.linalg.norm(FORCE, axis=1)
    index = np.flatnonzero((ROW >= 0) & (np.abs(norm - 9.81) < tolerance))
    _, measured = compass.measure(FORCE[index], SLOW_FIELD[ROW[index]])
    row = np.full(200, -1)
    row[index] = np.arange(len(index))
    out, state = np.full((200, 4), np.nan), kalman.new_state()
    first = kalman.run(STAMPS, RATE, measured, row, CONSTANTS, state, out)
    return first, out, state, len(index)


@pytest.mark.parametrize(("tolerance", "used"), [(np.inf, 50), (0.5, 20), (0.0, 0)])
def test_it_is_the_compass_and_the_filter(tolerance, used):
    state = kalman.new_state()
    first, out = fuse(STAMPS, RATE, FORCE, SLOW_FIELD, ROW, 9.81, tolerance, CONSTANTS, state)
    expected_first, expected, expected_state, count = in_two_steps(tolerance)
    assert count == pytest.approx(used, abs=12)
    assert first == expected_first
    assert out[first:].tobytes() == expected[first:].tobytes()
    assert state.tobytes() == expected_state.tobytes()


@settings(deadline=None)
@given(st.lists(st.integers(0, 200), max_size=8).map(sorted))
def test_any_split_into_blocks_gives_the_same_bytes(cuts):
    state = kalman.new_state()
    pieces = []
    for part in np.split(np.arange(200), cuts):
        present = ROW[part] >= 0
        local = np.where(present, np.cumsum(present) - 1, -1)
        field = SLOW_FIELD[ROW[part][present]]
        first, out = fuse(
            STAMPS[part], RATE[part], FORCE[part], field, local, 9.81, 0.5, CONSTANTS, state
        )
        pieces.append(out[first:])
    first, out, end, _ = in_two_steps(0.5)
    assert np.concatenate(pieces).tobytes() == out[first:].tobytes()
    assert state.tobytes() == end.tobytes()
