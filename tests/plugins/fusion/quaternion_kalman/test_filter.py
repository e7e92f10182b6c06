"""The quaternion Kalman filter against its equations, its golden number and its traps."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lodeflow_plugins.fusion.quaternion_kalman import filter as kalman
from lodeflow_plugins.fusion.tilt_compass import compass
from lodeflow_plugins.sources.simulated_vehicle import model

GOLDEN_QUATERNION = np.array([-0.1276794, 0.1448781, 0.2685358, 0.9437144])
GYRO_NOISE = np.radians(0.15)
RATE = 100
ROWS = 120 * RATE
STAMPS = np.arange(ROWS, dtype=np.int64) * (1_000_000_000 // RATE)
TRUTH = model.truth(model.Vehicle(), STAMPS * 1e-9)


def cross(w):
    return np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])


def omega(w):
    """Omega(w) of the compiled filter, from its A = I + Omega dt with dt = 1."""
    a = np.empty((4, 4))
    kalman.transition(w, 1.0, a)
    return a - np.eye(4)


def xi(q):
    """Eq. 25 as it has to be: [q4 I + [qv x]; -qv^T]."""
    return np.vstack([q[3] * np.eye(3) + cross(q[:3]), -q[:3]])


def reference(
    t, rate, measured, row, gyro_noise, r, p0, *, side=True, unit=True, usual_cross=False
):
    """Eqs. 18-29 in plain matrices, with the traps to be stepped into by choice."""
    x, p, out = None, None, []
    for k in range(len(t)):
        if x is None:
            x, p = measured[row[k]], p0 * np.eye(4)
        else:
            dt = (t[k] - t[k - 1]) * 1e-9
            w = rate[k]
            sign = 1.0 if usual_cross else -1.0  # Eq. 21 is the negative of the usual one
            a = np.eye(4) + 0.5 * dt * np.block([[sign * cross(w), w[:, None]], [-w, 0.0]])
            q = (0.5 * dt * gyro_noise) ** 2 * xi(x) @ xi(x).T
            x, p = a @ x, a @ p @ a.T + q
            if row[k] >= 0:
                z = measured[row[k]]
                if side and z @ x < 0.0:
                    z = -z
                gain = p @ np.linalg.inv(p + r * np.eye(4))
                x, p = x + gain @ (z - x), (np.eye(4) - gain) @ p
        if unit:
            x = x / np.linalg.norm(x)
        out.append(x)
    return np.array(out)


def run(t, rate, measured, row, constants, state=None):
    out = np.full((len(t), 4), np.nan)
    state = kalman.new_state() if state is None else state
    first = kalman.run(t, rate, measured, row, constants, state, out)
    return first, out, state


def vehicle_run(seed, variance=1e-3, initial=1e-6, bias=(0.0, 0.0, 0.0)):
    """Rate, measured quaternion and constants of the default vehicle, which starts at rest."""
    errors = model.Errors(gyroscope=model.SensorError(GYRO_NOISE, bias))
    readings = model.readings(TRUTH, errors, seed, 0)
    _, measured = compass.measure(readings.specific_force, readings.magnetic_field)
    return readings.angular_velocity, measured, kalman.constants(GYRO_NOISE, variance, initial)


def heading_error(quaternion, truth=TRUTH):
    """Degrees, signed."""
    error = np.degrees(compass.euler(quaternion)[:, 0] - truth.euler[:, 0])
    return (error + 180.0) % 360.0 - 180.0


def rms(x):
    return np.sqrt(np.mean(x**2))


def random_rows(seed, n):
    """Uneven stamps since 1970, rates, unit quaternions near a mean, and a row index with gaps."""
    rng = np.random.default_rng(seed)
    t = 1_700_000_000_123_456_789 + np.cumsum(rng.integers(1, 20_000_000, n))
    measured = rng.normal([0.3, -0.2, 0.4, 0.1], 0.05, (n, 4))
    measured *= rng.choice([-1.0, 1.0], (n, 1)) / np.linalg.norm(measured, axis=1)[:, None]
    row = np.where(rng.random(n) < 0.3, -1, rng.permutation(n))
    return t, rng.standard_normal((n, 3)), measured, row


def test_golden_process_noise():
    noise = np.empty((4, 4))
    kalman.process_noise(GOLDEN_QUATERNION, 0.01, 0.01**2, noise)
    golden = [
        [2.4592449, 0.0462449, 0.0857163, 0.3012323],
        [0.0462449, 2.4475258, -0.0972624, -0.3418089],
        [0.0857163, -0.0972624, 2.3197213, -0.6335528],
        [0.3012323, -0.3418089, -0.6335528, 0.273508],
    ]
    np.testing.assert_allclose(noise * 1e9, golden, atol=3e-7)


def test_omega_and_xi_are_the_same_derivative():
    rng = np.random.default_rng(0)
    for _ in range(20):
        q, w = rng.standard_normal(4), rng.standard_normal(3)
        q /= np.linalg.norm(q)
        np.testing.assert_allclose(omega(w) @ q, 0.5 * xi(q) @ w, atol=1e-15)
        np.testing.assert_allclose(xi(q) @ xi(q).T, np.eye(4) - np.outer(q, q), atol=1e-15)
        np.testing.assert_allclose(q @ xi(q), 0.0, atol=1e-15)
        noise = np.empty((4, 4))
        kalman.process_noise(q, 0.02, 0.3**2, noise)
        np.testing.assert_allclose(noise, (0.01 * 0.3) ** 2 * xi(q) @ xi(q).T, atol=1e-19)


def test_xi_as_printed_is_wrong():
    q1, q2, q3, q4 = q = GOLDEN_QUATERNION
    printed = -np.array([[-q4, -q3, -q2], [q2, -q4, -q1], [-q2, q1, -q4], [q1, q2, q3]])
    assert np.abs(q @ printed).max() > 0.03


def test_a_constant_rate_turns_about_its_axis():
    # v_earth = q v q*: turning left, from x forward = east, for a quarter of a turn.
    t = np.arange(10001, dtype=np.int64) * 100_000
    rate = np.tile([0.0, 0.0, np.pi / 2], (len(t), 1))
    row = np.full(len(t), -1)
    row[0] = 0
    start = np.array([[0.0, 0.0, 0.0, 1.0]])
    _, out, _ = run(t, rate, start, row, kalman.constants(0.1, 1.0, 1.0))
    np.testing.assert_allclose(out[-1], [0.0, 0.0, 0.5**0.5, 0.5**0.5], atol=1e-8)


@pytest.mark.parametrize("seed", range(5))
def test_it_is_eqs_24_to_29(seed):
    t, rate, measured, row = random_rows(seed, 300)
    row[0] = 7
    _, out, _ = run(t, rate, measured, row, kalman.constants(0.5, 0.02, 0.1))
    expected = reference(t, rate, measured, row, 0.5, 0.02, 0.1)
    np.testing.assert_allclose(np.abs(np.sum(out * expected, axis=1)), 1.0, atol=1e-13)
    gap = np.minimum(np.abs(out - expected).max(axis=1), np.abs(out + expected).max(axis=1))
    assert gap.max() < 1e-12


@pytest.mark.parametrize("seed", range(4))
def test_dynamic_run_of_a_shaken_vehicle(seed):
    rate, measured, constants = vehicle_run(seed)
    _, out, _ = run(STAMPS, rate, measured, np.arange(ROWS), constants)
    compass_error = heading_error(measured)
    assert rms(compass_error) == pytest.approx(4.2, abs=0.1)
    assert 13.0 < np.abs(compass_error).max() < 15.0
    error = heading_error(out)
    assert rms(error) < 0.09
    assert np.abs(error).max() < 0.2


@pytest.mark.parametrize("variance", [1e-3, 1e-2, 1e-1, 1.0])
def test_below_0_4_degrees_for_any_measurement_noise(variance):
    for seed in range(4):
        rate, measured, constants = vehicle_run(seed, variance)
        _, out, _ = run(STAMPS, rate, measured, np.arange(ROWS), constants)
        assert np.abs(heading_error(out)).max() < 0.4


def test_a_gyro_bias_is_not_estimated():
    # The estimate hangs behind by the bias times the time constant 2 sqrt(R) / sigma = 24 s.
    bias = np.radians(0.05)
    rate, measured, constants = vehicle_run(0, bias=(0.0, 0.0, bias))
    _, out, _ = run(STAMPS, rate, measured, np.arange(ROWS), constants)
    lag = -heading_error(out)[ROWS // 2 :].mean()  # a turn to the left is a lesser heading
    assert lag == pytest.approx(0.05 * 24.2, rel=0.15)


def steady_turn(degrees_per_second, variance):
    """A function that gives the heading RMS, in degrees, of the reference with its traps."""
    turn = model.Motion(slope=np.radians(degrees_per_second))
    truth = model.truth(dataclasses.replace(model.Vehicle(), heading=turn), STAMPS * 1e-9)
    readings = model.readings(truth, model.Errors(), 0, 0)
    euler, _ = compass.measure(readings.specific_force, readings.magnetic_field)
    eq_27 = np.array([compass.quaternion_from_euler(*angles) for angles in euler])
    measured = compass.swap_quaternion(eq_27)

    def error(**trap):
        q = reference(
            STAMPS,
            readings.angular_velocity,
            measured,
            np.arange(ROWS),
            GYRO_NOISE,
            variance,
            1e-6,
            **trap,
        )
        return rms(heading_error(q, truth))

    return error


def test_without_a_choice_of_side_or_with_the_usual_cross_product_it_fails():
    # A turn to the left from north: the sign of Eq. 27 changes where 0 becomes 360 degrees.
    error = steady_turn(-3.0, 1e-3)
    assert error() < 0.09
    assert error(side=False) > 3.0
    assert error(usual_cross=True) > 30.0


def test_without_unit_quaternions_the_angles_drift():
    error = steady_turn(12.0, 1.0)
    assert error(unit=False) > 2.0 * error()


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_the_sign_of_a_measurement_does_not_matter(seed):
    t, rate, measured, row = random_rows(seed, 40)
    constants = kalman.constants(0.5, 0.02, 0.1)
    first, out, _ = run(t, rate, measured, row, constants)
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], (40, 1))
    first_turned, turned, _ = run(t, rate, measured * signs, row, constants)
    assert first == first_turned
    assert out[first:].tobytes() == turned[first:].tobytes()
    assert out[first:, 3].min() >= 0.0
    np.testing.assert_allclose(np.linalg.norm(out[first:], axis=1), 1.0, atol=4e-16)


@settings(deadline=None)
@given(
    st.lists(st.integers(0, 60), max_size=8).map(sorted),
    st.integers(0, 2**32 - 1),
    st.integers(0, 60),
)
def test_any_split_into_blocks_gives_the_same_bytes(cuts, seed, silent):
    t, rate, measured, row = random_rows(seed, 60)
    row[:silent] = -1
    constants = kalman.constants(0.5, 0.02, 0.1)
    first, whole, end = run(t, rate, measured, row, constants)
    state = kalman.new_state()
    pieces = []
    for part in np.split(np.arange(60), cuts):
        # Each block carries only its own measurements, and an index into them.
        present = row[part] >= 0
        local = np.where(present, np.cumsum(present) - 1, -1)
        start, out, _ = run(
            t[part], rate[part], measured[row[part][present]], local, constants, state
        )
        pieces.append(out[start:])
    assert np.concatenate(pieces).tobytes() == whole[first:].tobytes()
    assert state.tobytes() == end.tobytes()


def test_nothing_comes_before_the_first_measurement():
    t, rate, measured, row = random_rows(3, 20)
    row[:] = -1
    constants = kalman.constants(0.5, 0.02, 0.1)
    first, out, state = run(t, rate, measured, row, constants)
    assert first == 20
    assert np.isnan(out).all()
    assert state.tobytes() == kalman.new_state().tobytes()
    row[12] = 5
    first, out, _ = run(t, rate, measured, row, constants)
    assert first == 12
    assert np.isnan(out[:12]).all()
    assert np.abs(out[12] @ measured[5]) == pytest.approx(1.0, abs=1e-15)


def test_stamps_since_1970_are_kept_to_the_nanosecond():
    t, rate, measured, row = random_rows(4, 10)
    _, _, state = run(t, rate, measured, row, kalman.constants(0.5, 0.02, 0.1))
    last = int(state[kalman.SECONDS]) * 10**9 + int(state[kalman.NANOSECONDS])
    assert last == t[-1]
    assert int(float(t[-1])) != t[-1]  # one float64 would not do


@pytest.mark.parametrize(
    ("values", "name"),
    [
        ((-1.0, 1.0, 1.0), "gyro_noise"),
        ((np.nan, 1.0, 1.0), "gyro_noise"),
        ((1.0, 0.0, 1.0), "measurement_variance"),
        ((1.0, np.inf, 1.0), "measurement_variance"),
        ((1.0, 1.0, -1e-9), "initial_variance"),
    ],
)
def test_mistakes_in_the_constants_are_named(values, name):
    with pytest.raises(ValueError, match=f"{name} must be finite and .*, got"):
        kalman.constants(*values)
