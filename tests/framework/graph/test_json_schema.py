"""The JSON Schema accepts what the loader accepts, and refuses typos."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import toys

import lodeflow as lf
from lodeflow.errors import NodeError
from lodeflow.graph import json_schema, load_graph
from lodeflow.graph.json_schema import schema

PLUGINS = {
    name: getattr(toys, name)
    for name in ("Vehicle", "Calibrator", "Fuser", "OtherFuser", "Display", "Mixer", "Rates")
}
WALK = Path(__file__).parent / "walk.yaml"
VALIDATOR = jsonschema.Draft202012Validator(schema(PLUGINS))


def document(**changes: Any) -> Any:
    """Return the plain graph of walk.yaml with plugins by their names, some values changed."""
    plain = json.loads(json.dumps(load_graph(WALK).document).replace("toys:", ""))
    for path, value in changes.items():
        *above, last = path.split("__")
        part = plain
        for name in above:
            part = part.setdefault(name, {})
        part[last] = value
    return plain


def test_it_is_a_json_schema() -> None:
    jsonschema.Draft202012Validator.check_schema(VALIDATOR.schema)
    text = json.dumps(VALIDATOR.schema)
    defined = VALIDATOR.schema["$defs"]
    assert {ref.split("/")[-1] for ref in re.findall(r'"#/\$defs/([^"]+)"', text)} <= set(defined)


GOOD: list[dict[str, Any]] = [
    {},
    {"nodes__fuser__params": {"gyro_noise": 0.1, "gain": "auto", "iterations": 9}},
    {"nodes__fuser__params": {"gyro_noise": "${seed}", "gain": "${seed}", "reject": "${seed}"}},
    {"nodes__cal__params": {"bias": [1, "${seed}", "3 LSB"], "scales": "${seed}"}},
    {"nodes__cal__params": {"bias": "${seed}", "scales": [1, "${seed}"], "file": "a/b"}},
    {"nodes__show__params": {"limits": {"low": "1 deg", "high": "${seed}"}, "depth": None}},
    {"nodes__show__params": {"limits": None}},
    {"nodes__other": {"use": "my.module:Node", "params": {"anything": 1}, "inputs": {"x": "cal"}}},
    {"nodes__other": {"use": "${seed}"}},
    {"nodes__cal__inputs__raw": "${seed}.mag"},
    {"record": None},
    {"record": {}},
]
TYPOS: list[dict[str, Any]] = [
    {"lodeflow": 2},
    {"name": "Walk"},
    {"nods": {}},
    {"nodes": {}},
    {"nodes__a-b": {"use": "Rates"}},
    {"nodes__fuser__parms": {}},
    {"nodes__fuser__use": "Fusre"},
    {"nodes__fuser__use": "graph:x.yaml"},
    {"nodes__fuser__params": {"gyro_nois": 0.1}},
    {"nodes__fuser__params": {"gyro_noise": 0}},
    {"nodes__fuser__params": {"gain": "aut"}},
    {"nodes__fuser__params": {"iterations": 10}},
    {"nodes__fuser__params": {"reject": "yes"}},
    {"nodes__fuser__inputs": {"imu": "vehicle.imu"}},
    {"nodes__fuser__inputs__magg": "cal"},
    {"nodes__fuser__inputs__mag": "a/b"},
    {"nodes__fuser__allow": ["late"]},
    {"nodes__cal__params": {}},
    {"nodes__cal__params": {"bias": [1, 2]}},
    {"nodes__cal__params": {"bias": [1, 2, None]}},
    {"nodes__cal": {"use": "Calibrator", "inputs": {"raw": "vehicle.mag"}}},
    {"nodes__show__params": {"limits": {"high": 1}}},
    {"nodes__show__params": {"limits": {"low": 1, "hihg": 1}}},
    {"nodes__vehicle__inputs": {"imu": "cal"}},
    {"nodes__vehicle__allow": ["lat"]},
    {"nodes__fuser__when": {"vehicle.mode": "compass"}},
    {"record": {"stream": "all"}},
    {"record": {"streams": "al"}},
    {"processes__sensors": []},
    {"args": []},
]


@pytest.mark.parametrize("changes", GOOD, ids=str)
def test_good_graphs(changes: dict[str, Any]) -> None:
    assert [error.message for error in VALIDATOR.iter_errors(document(**changes))] == []


@pytest.mark.parametrize("changes", TYPOS, ids=str)
def test_typos(changes: dict[str, Any]) -> None:
    assert not VALIDATOR.is_valid(document(**changes))


def test_editors_are_told_what_things_mean() -> None:
    use = VALIDATOR.schema["$defs"]["node"]["properties"]["use"]["anyOf"]
    assert {"const": "Display", "description": "A sink."} in use
    noise = VALIDATOR.schema["$defs"]["Fuser.params"]["properties"]["gyro_noise"]
    assert noise["description"] == (
        "Standard deviation of the angular rate. [rad/s | deg/s | °/s | deg/h | rpm]"
    )
    assert noise["default"] == 0.01


def test_installed_plugins(monkeypatch: pytest.MonkeyPatch) -> None:
    def load(name: str) -> type[lf.Node] | type[lf.Source]:
        if name == "broken":
            raise NodeError("no module named cuda")
        return toys.Vehicle

    class Known:
        nodes = {"vehicle": None, "broken": None}  # noqa: RUF012

    monkeypatch.setattr(json_schema, "registry", Known)
    monkeypatch.setattr(json_schema, "load_plugin", load)
    use = schema()["$defs"]["node"]["properties"]["use"]["anyOf"]
    assert {"const": "broken", "description": "Cannot be used: no module named cuda"} in use
    assert {"const": "vehicle", "description": "Everything that a vehicle measures."} in use


def test_parameters_that_have_no_json_form() -> None:
    class Odd(lf.Node):
        class Params(lf.Params):
            callback: complex = 1j
            centre: lf.Vec3 = [0, 0, 0]  # type: ignore[assignment]  # noqa: RUF012

        def step(self, rate: lf.AngularRate) -> None: ...

    jsonschema.Draft202012Validator.check_schema(schema({"odd": Odd}))
