"""Mean, spread and maximum of a difference, as it goes."""

import math

import numpy as np
from numba import njit

# The state of `accumulate`, float64.
SAMPLES, MEAN, SPREAD, SQUARES, MAXIMUM = range(5)
STATE_SIZE = 5


def new_state() -> np.ndarray:
    """State that has seen nothing, float64 (5,)."""
    return np.zeros(STATE_SIZE)


@njit(cache=True)
def accumulate(estimate: np.ndarray, reference: np.ndarray, state: np.ndarray) -> None:
    """Add the rows of a block, (N,) each; any split into blocks gives the same bytes.

    The spread is kept as the sum of squares about the mean so far (Welford 1962).
    """
    for k in range(len(estimate)):
        difference = estimate[k] - reference[k]
        state[SAMPLES] += 1.0
        before = difference - state[MEAN]
        state[MEAN] += before / state[SAMPLES]
        state[SPREAD] += before * (difference - state[MEAN])
        state[SQUARES] += difference * difference
        state[MAXIMUM] = max(state[MAXIMUM], abs(difference))


def figures(state: np.ndarray) -> tuple[float, float, float, float, int]:
    """Mean, standard deviation, root mean square, largest size, and number of samples."""
    n = state.item(SAMPLES)
    spread, squares = state.item(SPREAD) / n, state.item(SQUARES) / n
    return state.item(MEAN), math.sqrt(spread), math.sqrt(squares), state.item(MAXIMUM), int(n)
