"""The exception tree, and the nearest known word."""

from __future__ import annotations

import pickle
import re

import pytest

from lodeflow import errors
from lodeflow.errors import GraphError, LodeflowError, did_you_mean


def test_the_tree_in_the_docstring_is_the_tree_of_classes() -> None:
    drawn = {}
    above: list[str] = []
    for line in errors.__doc__.splitlines():
        found = re.match(r"^([ │├└─]*)([A-Z]\w+Error|NodeFailure)\b", line)
        if found:
            depth = len(found[1]) // 4
            above[depth:] = [found[2]]
            drawn[found[2]] = above[depth - 1] if depth else "Exception"
    classes = {
        name: value.__bases__[0].__name__
        for name, value in vars(errors).items()
        if isinstance(value, type) and issubclass(value, LodeflowError)
    }
    assert drawn == classes
    assert len(drawn) == 9


def test_a_graph_error_holds_all_problems() -> None:
    error = GraphError(["a.yaml:1:1: first", "a.yaml:2:1: second"])
    assert error.problems == ("a.yaml:1:1: first", "a.yaml:2:1: second")
    assert str(error) == "a.yaml:1:1: first\na.yaml:2:1: second"


def test_errors_can_be_sent_to_another_process() -> None:
    error = GraphError(["first", "second"])
    again = pickle.loads(pickle.dumps(error))
    assert (str(again), again.problems) == (str(error), error.problems)


@pytest.mark.parametrize(
    ("word", "known", "text"),
    [
        ("gyro_nois", ["mag_noise", "gyro_noise"], ", did you mean 'gyro_noise'?"),
        ("IMU", ["imu", "mag"], ", did you mean 'imu'?"),
        ("imu", ["Imu"], ", did you mean 'Imu'?"),
        ("xyz", ["imu", "mag"], ""),
        ("x", [], ""),
    ],
)
def test_did_you_mean(word: str, known: list[str], text: str) -> None:
    assert did_you_mean(word, known) == text
