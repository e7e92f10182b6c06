"""The few operations on columns whose obvious form would give other bits for other block sizes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def rotate(matrix: NDArray[np.float64], vectors: NDArray[np.float64]) -> NDArray[Any]:
    """Return `matrix @ v` for each vector, with the same bits for one vector as for many.

    `vectors @ matrix.T` would go through another routine for one row than for several.

    Args:
        matrix: (3, 3).
        vectors: (..., 3).

    Returns:
        (..., 3).
    """
    product: NDArray[Any] = (matrix @ vectors[..., None])[..., 0]
    return product
