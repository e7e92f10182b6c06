"""Operations on columns: the same bits for one row as for many."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

import lodeflow as lf


@given(st.integers(0, 2**32), st.integers(1, 40))
@settings(max_examples=100, deadline=None, derandomize=True, database=None)
def test_rotate_has_the_same_bits_for_any_number_of_rows(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    matrix, vectors = rng.standard_normal((3, 3)), rng.standard_normal((n, 3))
    together = lf.rotate(matrix, vectors)
    assert together.shape == (n, 3)
    assert together.flags.c_contiguous
    assert together.tobytes() == b"".join(lf.rotate(matrix, v).tobytes() for v in vectors)
    np.testing.assert_allclose(together, vectors @ matrix.T, rtol=1e-12, atol=1e-14)


def test_rotate_turns_x_into_y() -> None:
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    assert lf.rotate(quarter, np.array([1.0, 0, 0])).tolist() == [0, 1, 0]
    assert lf.rotate(quarter, np.empty((0, 3))).shape == (0, 3)
