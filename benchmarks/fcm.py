"""Time fuzzy c-means beside scikit-fuzzy, fuzzy-c-means and plain numpy, per iteration.

    python benchmarks/fcm.py [--points 10000 100000] [--rounds 5] [--json]

Five clusters of two features, m = 2. All start from random memberships and run the same number of
iterations; they take turns, the median round counts, and ratios are to scikit-fuzzy. What is not
installed is left out; fuzzy-c-means asks for an older numpy than lodeflow does, so it needs
`pip install --no-deps fuzzy-c-means`.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from collections.abc import Callable

import numpy as np

from lodeflow_plugins.interference import fuzzy_c_means

CLUSTERS, ITERATIONS, NEVER = 5, 40, 1e-9


def ours(points: np.ndarray) -> None:
    fuzzy_c_means.fit(points, CLUSTERS, tolerance=NEVER, most_iterations=ITERATIONS)


def numpy_alone(points: np.ndarray) -> None:
    """Distances by one matrix product, as one would write it without a compiler."""
    u = np.random.default_rng(0).random((len(points), CLUSTERS))
    u /= u.sum(axis=1, keepdims=True)
    square = (points * points).sum(axis=1)[:, None]
    for _ in range(ITERATIONS):
        weight = u * u
        centres = (weight.T @ points) / weight.sum(axis=0)[:, None]
        distance = square - 2.0 * points @ centres.T + (centres * centres).sum(axis=1)
        inverse = 1.0 / np.maximum(distance, 1e-300)
        new = inverse / inverse.sum(axis=1, keepdims=True)
        np.abs(new - u).max()
        u = new


def candidates() -> dict[str, Callable[[np.ndarray], None]]:
    found = {"lodeflow": ours, "numpy": numpy_alone}
    try:
        import skfuzzy

        found["scikit-fuzzy"] = lambda points: skfuzzy.cmeans(
            points.T, CLUSTERS, 2.0, error=NEVER, maxiter=ITERATIONS, seed=0
        )
    except ImportError:
        pass
    try:
        from fcmeans import FCM

        found["fuzzy-c-means"] = lambda points: FCM(
            n_clusters=CLUSTERS, m=2.0, max_iter=ITERATIONS, error=NEVER, random_state=0
        ).fit(points)
    except ImportError:
        pass
    return found


def measure(n: int, rounds: int) -> dict[str, float]:
    """Milliseconds per iteration of each, with n points."""
    points = np.abs(np.random.default_rng(1).standard_normal((n, 2)))
    times: dict[str, list[float]] = {name: [] for name in candidates()}
    for _ in range(rounds + 1):
        for name, run in candidates().items():
            begin = time.perf_counter()
            run(points)
            times[name].append((time.perf_counter() - begin) / ITERATIONS * 1e3)
    return {name: statistics.median(found[1:]) for name, found in times.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--points", type=int, nargs="+", default=[10_000, 100_000])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    results = {n: measure(n, options.rounds) for n in options.points}
    if options.json:
        print(json.dumps(results))
        return
    for n, found in results.items():
        print(f"{n} points, ms per iteration")
        base = found.get("scikit-fuzzy")
        for name, value in sorted(found.items(), key=lambda item: item[1]):
            ratio = f"{base / value:8.1f} times scikit-fuzzy" if base else ""
            print(f"  {name:15s} {value:9.3f} {ratio}")


if __name__ == "__main__":
    main()
