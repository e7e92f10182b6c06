"""The low-pass without phase, and its streaming forms."""

import numpy as np
import pytest
import scipy.signal
from hypothesis import given, settings
from hypothesis import strategies as st

from lodeflow_plugins.filtering import smoothing

RATE = 50.0


@pytest.mark.parametrize("weights", [smoothing.low_pass(2.0, RATE), smoothing.hann(0.2, RATE)])
def test_weights_are_symmetric_odd_and_of_sum_one(weights):
    assert len(weights) % 2 == 1
    np.testing.assert_allclose(weights, weights[::-1], rtol=1e-14)
    assert weights.sum() == pytest.approx(1.0, abs=1e-14)


def test_the_low_pass_is_a_butterworth_filter_run_forth_and_back():
    rng = np.random.default_rng(0)
    signal = np.cumsum(rng.standard_normal(1500))
    numerator, denominator = scipy.signal.butter(2, 2.0, fs=RATE)
    expected = scipy.signal.filtfilt(numerator, denominator, signal)
    ours = np.convolve(signal, smoothing.low_pass(2.0, RATE), "same")
    inner = slice(100, -100)
    error = np.std(ours[inner] - expected[inner]) / np.std(signal[inner] - expected[inner])
    assert error < 0.05


def test_it_halves_the_signal_at_the_cutoff():
    weights = smoothing.low_pass(0.5, RATE)
    half = len(weights) // 2
    gain = weights @ np.cos(2 * np.pi * 0.5 * np.arange(-half, half + 1) / RATE)
    assert gain == pytest.approx(0.5, abs=0.01)


def test_push_delays_by_half_a_window_and_begins_as_if_it_had_always_been_so():
    weights = smoothing.hann(0.1, RATE)
    state = smoothing.new_state(weights)
    half = len(weights) // 2
    pushed = [smoothing.push(10 * k, float(k), weights, *state) for k in range(20)]
    assert [at for _, at in pushed] == [max(0, 10 * (k - half)) for k in range(20)]
    assert pushed[0][0] == 0.0
    for k in range(2 * half, 20):
        assert pushed[k][0] == pytest.approx(k - half)


@settings(deadline=None)  # the first example compiles
@given(st.lists(st.integers(0, 40), max_size=5), st.integers(1, 3))
def test_columns_are_smoothed_alike_whatever_the_blocks(cuts, columns):
    rng = np.random.default_rng(1)
    t, values = np.arange(40) * 7, rng.standard_normal((40, columns))
    weights = smoothing.hann(0.2, RATE)

    def run(cuts):
        state = smoothing.new_columns(weights, columns)
        parts = []
        for a, b in zip([0, *cuts], [*cuts, 40], strict=True):
            at, out = np.empty(b - a, np.int64), np.empty((b - a, columns))
            found = smoothing.smooth(t[a:b], values[a:b], weights, *state, at, out)
            parts.append((at[:found], out[:found]))
        return [np.concatenate(part) for part in zip(*parts, strict=True)]

    at, out = run([])
    n = len(weights)
    assert at.tolist() == t[n // 2 : -(n // 2)].tolist()
    expected = [np.convolve(column, weights, "valid") for column in values.T]
    np.testing.assert_allclose(out.T, expected, atol=1e-14)
    split_at, split = run(sorted(cuts))
    assert split_at.tobytes() == at.tobytes()
    assert split.tobytes() == out.tobytes()
