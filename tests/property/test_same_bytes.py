"""Each stream's bytes do not depend on blocks, interleaving, or the driver."""

from __future__ import annotations

import random

from definition import run_by_definition
from graphs import Case, cases, run_blocks, run_samples
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

SETTINGS = settings(
    max_examples=1200,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)


def compare(case: Case, seed: int) -> None:
    """Run a case in every way and hold the results together."""
    rng = random.Random(seed)
    streams, counted = run_blocks(case, rng, whole=True)
    for other, other_counted in (
        run_blocks(case, rng, whole=False),
        run_samples(case, rng),
    ):
        assert other == streams
        assert other_counted == counted
    defined = run_by_definition(case)
    if defined is not None:
        assert defined == (streams, counted)


@SETTINGS
@given(cases(), st.integers(0, 2**32))
def test_streams_do_not_depend_on_blocks_interleaving_or_driver(case: Case, seed: int) -> None:
    compare(case, seed)
