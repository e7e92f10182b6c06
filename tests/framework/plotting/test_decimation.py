"""A thinned line against the whole one: the same in each column of pixels."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lodeflow.plotting.decimation import BINS, Series, Spans, broken, kept

values = st.lists(st.one_of(st.integers(-3, 3).map(float), st.just(np.nan)), min_size=1)


@given(st.data(), values, st.integers(1, 9))
def test_each_column_keeps_its_ends_its_extremes_and_its_gap(data, values, bins):
    v = np.array(values)
    steps = data.draw(st.lists(st.integers(1, 5), min_size=len(v), max_size=len(v)))
    t = np.cumsum(steps)
    start, end = int(t[0]), int(t[-1]) + 1
    rows = kept(t, v, start, end, bins)
    assert (np.diff(rows) > 0).all()
    column = (t - start) // -(-(end - start) // bins)
    assert len(rows) <= 5 * (column.max() + 1)
    for one in np.unique(column):
        every, some = v[column == one], v[rows][column[rows] == one]
        assert np.array_equal(every[[0, -1]], some[[0, -1]], equal_nan=True)
        assert np.isnan(every).any() == np.isnan(some).any()
        if not np.isnan(every).all():
            assert (np.nanmin(every), np.nanmax(every)) == (np.nanmin(some), np.nanmax(some))


def test_a_spike_and_a_gap_of_a_long_series_stay_however_it_comes():
    count = 60 * BINS
    t = np.arange(count)
    v = np.sin(t / 1e3)
    v[12_345], v[70_000:80_000] = 50.0, np.nan
    whole, pieces = Series(0, count), Series(0, count)
    whole.add(t, v)
    for piece in np.array_split(np.arange(count), 401):
        pieces.add(t[piece], v[piece])
    for series in (whole, pieces):
        shown_t, shown = series.points()
        assert series.count == count
        assert len(shown) <= 5 * BINS
        assert shown[shown_t == 12_345] == [50.0]
        inside = (shown_t >= 70_000) & (shown_t < 80_000)
        assert inside.any()
        assert np.isnan(shown[inside]).all()


def test_a_short_series_stays_as_it_is():
    t, v = np.arange(100), np.random.default_rng(0).normal(size=100)
    series = Series(0, 100)
    series.add(t, v)
    assert np.array_equal(series.points(), [t, v])
    assert [part.tolist() for part in Series(0, 1).points()] == [[], []]


@given(st.lists(st.integers(0, 2), min_size=1), st.integers(1, 5))
def test_a_mode_is_kept_as_its_changes(modes, size):
    spans = Spans()
    for first in range(0, len(modes), size):
        part = np.array(modes[first : first + size], dtype=float)
        spans.add(np.arange(first, first + len(part)), part)
    t, changes = spans.points()
    assert (np.diff(changes) != 0).all()
    rebuilt = changes[np.searchsorted(t, np.arange(len(modes)), side="right") - 1]
    assert rebuilt.tolist() == modes
    assert spans.count == len(modes)


def test_an_angle_is_not_drawn_across_the_figure_where_it_wraps():
    t = np.arange(5.0)
    shown_t, shown = broken(t, np.array([350.0, 359.0, 2.0, np.nan, 180.0]), 360.0)
    assert shown_t.tolist() == [0, 1, 2, 2, 3, 4]
    assert np.array_equal(shown, [350, 359, np.nan, 2, np.nan, 180], equal_nan=True)


@pytest.mark.parametrize("values", [[1.0, 179.0, 359.0], [0.0, -180.0]])
def test_a_fast_turn_is_no_wrap(values):
    assert broken(np.arange(len(values)), np.array(values), 360.0)[1].tolist() == values
