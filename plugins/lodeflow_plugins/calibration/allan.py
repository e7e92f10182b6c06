"""Overlapping Allan deviation of a sensor at rest, and the noises that it is made of.

Source: IEEE Std 952-1997, annex C: variance over the averaging time tau of quantization noise Q,
white noise (angle random walk) N, flicker (bias instability) B, and rate random walk K,

    sigma^2(tau) = 3 Q^2 / tau^2 + N^2 / tau + (2 ln 2 / pi) B^2 + K^2 tau / 3.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

PER_DECADE = 10
SIGNIFICANT = 3.0
"""A noise is shown by a record if its variance is so many standard errors above none."""
FEWEST_CLUSTERS = 9
"""The longest averaging time is so many times shorter than the record."""


@dataclass(frozen=True, eq=False)
class Noises:
    """Allan deviation (T,) over averaging times tau (T,), s, and the coefficients behind it.

    relative_error: (T,), standard error of the deviation as part of it; coefficients: (4,) Q, N,
    B, K in the unit of the signal u: u s, u/sqrt(Hz), u, u/sqrt(s); NaN where the record does not
    show that noise; errors: (4,), approximate standard errors.
    """

    tau: np.ndarray
    deviation: np.ndarray
    relative_error: np.ndarray
    coefficients: np.ndarray
    errors: np.ndarray


def analyse(signal: np.ndarray, rate: float) -> Noises:
    """Return the Allan deviation of a signal (N,), sampled at a rate in Hz, and its noises.

    Raises ValueError for fewer than 200 samples, or a signal that never changes.
    """
    if len(signal) < 200:
        raise ValueError(f"{len(signal)} samples; at least 200 are needed")
    sizes = cluster_sizes(len(signal))
    deviation = np.array([_deviation(signal, size) for size in sizes])
    if not deviation.max() > 0.0:
        raise ValueError("the signal never changes: its noise is below one step of the converter")
    tau = sizes / rate
    relative = 1.0 / np.sqrt(2.0 * (len(signal) / sizes - 1.0))
    coefficients, errors = _coefficients(tau, deviation, relative)
    return Noises(tau, deviation, relative, coefficients, errors)


def cluster_sizes(samples: int) -> np.ndarray:
    """Return numbers of samples to average, logarithmically spaced."""
    most = samples // FEWEST_CLUSTERS
    return np.unique(np.geomspace(1, most, round(PER_DECADE * np.log10(most)) + 1).astype(int))


def _deviation(signal: np.ndarray, size: int) -> float:
    integral = np.concatenate([[0.0], np.cumsum(signal - signal.mean())])
    second = integral[2 * size :] - 2.0 * integral[size:-size] + integral[: -2 * size]
    return float(np.sqrt(np.mean(second**2) / (2.0 * size**2)))


def _coefficients(
    tau: np.ndarray, deviation: np.ndarray, relative: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    factors = np.array([3.0, 1.0, 2.0 * np.log(2.0) / np.pi, 1.0 / 3.0])
    powers = np.column_stack([tau**-2.0, tau**-1.0, np.ones(len(tau)), tau])
    weight = 1.0 / (2.0 * relative * deviation**2)  # of the variance
    design = powers * factors * weight[:, None]
    scale = np.linalg.norm(design, axis=0)
    solution, _ = nnls(design / scale, deviation**2 * weight)
    squares = solution / scale
    # Neighbours share most of their samples, so that not each averaging time tells something new.
    repeated = len(tau) / max(np.log2(tau[-1] / tau[0]), 1.0)
    covariance = np.linalg.pinv(design.T @ design) * repeated
    deviations = np.sqrt(np.diagonal(covariance))
    shown = squares > SIGNIFICANT * deviations
    found = np.sqrt(np.where(shown, squares, np.nan))
    return found, deviations / (2.0 * found)
