"""Time fuzzy c-means beside scikit-fuzzy, fuzzy-c-means and plain numpy, per iteration.

    python benchmarks/fcm.py [--points 10000 100000] [--rounds 5] [--json]

Five clusters of two features, m = 2. All start from the same memberships and run the same number of
iterations, counted; they take turns, and ratios are to scikit-fuzzy, the median over the rounds.
Times are of the processor, all threads together, so that a busy machine disturbs them less. What is
not installed is left out; fuzzy-c-means draws the same memberships from the same seed itself, and
asks for an older numpy than lodeflow does, so it needs `pip install --no-deps fuzzy-c-means`.
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


def ours(points: np.ndarray, u: np.ndarray) -> int:
    return fuzzy_c_means.fit(
        points, CLUSTERS, tolerance=NEVER, most_iterations=ITERATIONS, initial=u
    ).iterations


def numpy_alone(points: np.ndarray, u: np.ndarray) -> int:
    """Distances by one matrix product, as one would write it without a compiler."""
    square = (points * points).sum(axis=1)[:, None]
    for _ in range(ITERATIONS):
        weight = u * u
        centres = (weight.T @ points) / weight.sum(axis=0)[:, None]
        distance = square - 2.0 * points @ centres.T + (centres * centres).sum(axis=1)
        inverse = 1.0 / np.maximum(distance, 1e-300)
        new = inverse / inverse.sum(axis=1, keepdims=True)
        np.abs(new - u).max()
        u = new
    return ITERATIONS


def candidates() -> dict[str, Callable[[np.ndarray, np.ndarray], int]]:
    """What there is to compare; each returns how many iterations it made."""
    found: dict[str, Callable[[np.ndarray, np.ndarray], int]] = {
        "lodeflow": ours,
        "numpy": numpy_alone,
    }
    try:
        import skfuzzy

        found["scikit-fuzzy"] = lambda points, u: skfuzzy.cmeans(
            points.T, CLUSTERS, 2.0, error=NEVER, maxiter=ITERATIONS, init=u.T
        )[5]
    except ImportError:
        pass
    try:
        from fcmeans import FCM

        def fcmeans(points: np.ndarray, _: np.ndarray) -> int:
            FCM(n_clusters=CLUSTERS, m=2.0, max_iter=ITERATIONS, error=NEVER, random_state=0).fit(
                points
            )
            return ITERATIONS

        found["fuzzy-c-means"] = fcmeans
    except ImportError:
        pass
    return found


def measure(n: int, rounds: int) -> dict[str, list[float]]:
    """Milliseconds per iteration of each in each round, with n points."""
    points = np.abs(np.random.default_rng(1).standard_normal((n, 2)))
    u = np.random.default_rng(0).random((n, CLUSTERS))
    u /= u.sum(axis=1, keepdims=True)
    runs = candidates()
    times: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(rounds + 1):
        for name, run in runs.items():
            begin = time.process_time()
            iterations = run(points, u)
            times[name].append((time.process_time() - begin) / ITERATIONS * 1e3)
            if iterations != ITERATIONS:
                raise SystemExit(f"{name} made {iterations} iterations, not {ITERATIONS}")
    return {name: found[1:] for name, found in times.items()}  # the first one compiles


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
        for name, values in sorted(found.items(), key=lambda item: statistics.median(item[1])):
            ratios = [b / v for b, v in zip(base, values, strict=True)] if base else []
            ratio = f"{statistics.median(ratios):8.1f} times scikit-fuzzy" if base else ""
            print(f"  {name:15s} {statistics.median(values):9.3f} {ratio}")


if __name__ == "__main__":
    main()
