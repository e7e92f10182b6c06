"""Each stream's bytes do not depend on blocks, interleaving, or the driver."""

from __future__ import annotations

from definition import compare
from graphs import Case, cases
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

SETTINGS = settings(
    max_examples=1200,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)


@SETTINGS
@given(cases(), st.integers(0, 2**32))
def test_streams_do_not_depend_on_blocks_interleaving_or_driver(case: Case, seed: int) -> None:
    compare(case, seed)
