"""What two answers of each process say of the time between them."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np
import pytest

from lodeflow.supervisor.vitals import vitals

ABOUT = {
    "a": {
        "groups": ["a", "b"],
        "order": ["src", "mid", "end"],
        "paths": [["src", "end"], ["src", "gone"]],
    }
}


def packed(*pairs: tuple[int, int]) -> str:
    return base64.b64encode(np.array(pairs, dtype="<i8").tobytes()).decode()


def stats(seconds: float, **more: Any) -> dict[str, Any]:
    return {
        "pid": 1,
        "seconds": seconds,
        "reached": int(seconds * 1e9),
        "paced": True,
        "cpu_seconds": seconds / 4,
        "resident_bytes": 1000,
        "nodes": {},
        "inboxes": {},
        "waiting": {},
        "links": {},
        "foreign": 0,
        "passings": {},
        **more,
    }


def node(stepped: int, **sent: int) -> dict[str, Any]:
    return {
        "stepped": stepped,
        "unmatched": 2,
        "gated": 0,
        "sent": sent,
        "lost": {"late": 3} if not stepped else {},
    }


def test_rates_usage_and_latencies() -> None:
    link = {"waiting": 4, "arrived": 5, "gaps": 1, "restarts": 0, "undecodable": 0, "missed": 0}
    before = {
        "a": stats(10.0, nodes={"src": node(0, src=100)}),
        "b": stats(20.0, nodes={"end": node(50, end=50), "mid": node(1, mid=1)}, pid=2),
    }
    after = {
        "a": stats(
            12.0,
            nodes={"src": node(0, src=300)},
            inboxes={"src": 7},
            passings={"sources": {"src": packed((0, 100), (10, 110))}, "ends": {}},
        ),
        "b": stats(
            22.0,
            nodes={"end": node(60, end=54), "mid": node(1, mid=1)},
            waiting={"end": 9},
            links={"a": link},
            pid=2,
            passings={"sources": {}, "ends": {"end": packed((0, 1100), (10, 3110))}},
        ),
    }
    found = vitals(ABOUT, before, after)
    assert list(found.nodes) == ["src", "mid", "end"]
    assert found.rates == {"src": 100.0, "mid": 0.0, "end": 2.0}
    assert found.nodes["end"].stepped == 5.0
    assert (found.nodes["end"].waiting, found.nodes["src"].waiting) == (9, 7)
    assert found.nodes["src"].lost == {"late": 3}
    assert found.processes["a"].cpu == 0.25
    assert found.processes["b"].lost == {"gaps from a": 1}
    assert (found.processes["b"].waiting, found.processes["b"].arrived) == (4, 5)
    (path,) = found.paths
    assert (path.source, path.end, path.count) == ("src", "end", 2)
    assert path.p50 == pytest.approx(2e-6)
    assert found.silent == []
    assert found.as_dict()["processes"]["b"]["pid"] == 2


def test_a_process_that_does_not_answer_is_named() -> None:
    told = {"a": stats(1.0)}
    assert vitals(ABOUT, told, {"a": stats(2.0)}).silent == ["b"]


def test_a_process_that_was_started_again_is_compared_to_itself_only() -> None:
    before = {"a": stats(50.0, nodes={"src": node(5, src=500)}, pid=7)}
    after = {"a": stats(1.0, nodes={"src": node(5, src=10)}, pid=8)}
    assert vitals(ABOUT, before, after).nodes == {}
    assert vitals(ABOUT, before, after).silent == ["b"]


def test_a_run_that_is_not_paced_has_no_latencies() -> None:
    before, after = stats(1.0, paced=False), stats(2.0, paced=False)
    found = vitals(ABOUT, {"a": before}, {"a": after})
    assert not found.paced
    assert found.paths == []
