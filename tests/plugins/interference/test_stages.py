"""Features, thresholds, clusters, mode and the paper's heading."""

import numpy as np
import pytest
from pydantic import ValidationError

import lodeflow as lf
from lodeflow.testing import check_node, run_node
from lodeflow_plugins.interference.dmc_features import DmcFeatures
from lodeflow_plugins.interference.fcm_stage import FcmStage
from lodeflow_plugins.interference.fuzzy_c_means import memberships
from lodeflow_plugins.interference.integrated_heading import IntegratedHeading
from lodeflow_plugins.interference.mode_switch import ModeSwitch
from lodeflow_plugins.interference.threshold_stage import ThresholdStage

SECOND = 10**9
R = 33.5e-6


def field(headings, strengths, t):
    """Level fields of a compass that shows these headings, rad, clockwise from north."""
    x, y = strengths * np.cos(headings), strengths * np.sin(headings)
    return lf.MagneticField(np.asarray(t), R * np.column_stack([x, y, np.full(len(x), -1.1)]))


def features_of(n=4, **changes):
    zero, two = np.zeros(n), np.zeros((n, 2))
    columns = {
        "heading": zero, "headings": two, "heading_difference": zero,
        "heading_difference_rate": zero, "field_error": two, "field_error_rate": two,
        "first_field": np.zeros((n, 3)), "second_field": np.zeros((n, 3)),
    } | {name: np.asarray(value, float) for name, value in changes.items()}  # fmt: skip
    return lf.CompassFeatures(np.arange(n) * SECOND, **columns)


def test_features_by_hand():
    t = np.array([0, 1, 3, 10]) * SECOND
    first = field(np.radians([10, 20, 350, 5]), np.array([1.0, 1.1, 0.9, 1.2]), t)
    second = field(np.radians([8, 20, 10, 3]), np.array([1.0, 1.0, 1.0, 1.0]), t)
    out = run_node(
        DmcFeatures,
        {"field": R, "initial_difference": "1 deg", "gap": 5},
        first=first,
        second=second,
    )["out"]
    np.testing.assert_allclose(np.degrees(out.heading_difference), [1, -1, -21, 1])
    np.testing.assert_allclose(np.degrees(out.heading_difference_rate), [0, -2, -10, 0], atol=1e-9)
    np.testing.assert_allclose(out.field_error[:, 0], [0, 0.1, -0.1, 0.2], atol=1e-12)
    np.testing.assert_allclose(out.field_error_rate[:, 0], [0, 0.1, -0.1, 0], atol=1e-12)
    np.testing.assert_allclose(np.degrees(out.headings[2]), [350, 10])
    # The middle of both, each moved by half of what they differ undisturbed.
    np.testing.assert_allclose(np.degrees(out.heading), [9, 20, 0, 4], atol=1e-9)
    np.testing.assert_allclose(out.first_field[:, 2], -1.1)


def test_rates_over_an_interval():
    t = np.arange(0, 4 * SECOND, SECOND // 10)
    strengths = 1.0 + 0.1 * t * 1e-9
    mag = field(np.zeros(len(t)), strengths, t)
    out = run_node(DmcFeatures, {"rate_interval": 1, "field": R}, first=mag, second=mag)["out"]
    np.testing.assert_allclose(out.field_error_rate[1:], 0.1, atol=1e-9)
    jump = np.where(t < 2 * SECOND, 1.0, 1.5)
    mag = field(np.zeros(len(t)), jump, t)
    out = run_node(DmcFeatures, {"rate_interval": 1, "field": R}, first=mag, second=mag)["out"]
    seen = out.field_error_rate[:, 0] > 0.4
    assert seen.sum() == 10  # for one interval
    check_node(DmcFeatures, {"rate_interval": 1}, inputs={"first": mag, "second": mag})


@pytest.mark.parametrize(
    ("changed", "compasses", "accepted"),
    [
        ({}, "both", True),
        ({"field_error": [[0.0, 0.2]] * 4}, "both", False),
        ({"field_error": [[0.0, -0.2]] * 4}, "first", True),
        ({"field_error": [[-0.2, 0.0]] * 4}, "first", False),
        ({"field_error_rate": [[0.0, 0.1]] * 4}, "both", False),
        ({"heading_difference": np.radians([-9] * 4)}, "both", False),
        ({"heading_difference_rate": np.radians([9] * 4)}, "both", False),
        ({"heading_difference_rate": np.radians([7] * 4)}, "both", True),
    ],
)
def test_thresholds(changed, compasses, accepted):
    out = run_node(ThresholdStage, {"compasses": compasses}, features=features_of(**changed))["out"]
    assert (out.valid == accepted).all()
    assert (out.credibility == accepted).all()


def test_thresholds_that_are_null_do_not_test():
    names = ("field_error", "field_error_rate", "heading_difference", "heading_difference_rate")
    wild = features_of(field_error=[[9, 9]] * 4, heading_difference=[3] * 4)
    out = run_node(ThresholdStage, dict.fromkeys(names), features=wild)["out"]
    assert out.valid.all()


def test_credibility_is_that_of_the_lesser_compass():
    example = FcmStage.example
    features = features_of(
        field_error=[[0.01, 0.01], [0.01, -0.12], [0.17, 0.17], [0.0, 0.0]],
        heading_difference=np.radians([0.5, -0.5, 7.0, 0.0]),
    )
    passed = lf.Credibility(features.t, np.ones(4), np.array([1, 1, 1, 0]))
    out = run_node(FcmStage, example, features=features, passed=passed)["out"]
    v = [200 / 1168, np.radians(8)]
    by_hand = [
        memberships(
            np.abs(np.column_stack([features.field_error[:, k], features.heading_difference])) / v,
            np.array(example["first_centres"]),
        )[:, -2:].sum(axis=1)
        for k in range(2)
    ]
    expected = np.minimum(*by_hand)
    expected[3] = 0.0  # the stage before has refused it
    np.testing.assert_allclose(out.credibility, expected)
    assert out.valid.tolist() == [1, 0, 0, 0]


def test_centres_in_another_order_are_refused():
    turned = [*reversed(FcmStage.example["first_centres"])]
    with pytest.raises(ValidationError, match="the farthest first"):
        FcmStage.Params(first_centres=turned, second_centres=FcmStage.example["second_centres"])


def modes(valid, **params):
    t = np.arange(len(valid)) * SECOND
    credibility = lf.Credibility(t, np.array(valid, float), np.array(valid))
    check_node(ModeSwitch, params, inputs={"credibility": credibility})
    found = run_node(ModeSwitch, params, credibility=credibility)["out"].mode
    return "".join({lf.Mode.COMPASS: "C", lf.Mode.GYRO: "G"}[m] for m in found.tolist())


def test_modes():
    valid = [1, 1, 0, 1, 0, 0, 0, 1, 1, 1, 0]
    assert modes(valid) == "CCGCGGGCCCG"
    assert modes(valid, leave_after=1) == "CCCCCGGCCCC"
    assert modes(valid, return_after=2) == "CCGGGGGGGCG"
    assert modes(valid, dwell=3) == "CCCCGGGCCCG"
    assert modes([0, 0, 1]) == "GGC"


def test_the_integrated_heading_follows_compass_then_gyro():
    t = np.arange(0, 6 * SECOND, SECOND // 2)
    compass = features_of(len(t), heading=np.radians(np.full(len(t), 350.0))).replace(t=t)
    mode = lf.Mode(np.array([0, 2 * SECOND, 5 * SECOND]), np.array([1, 2, 1]))
    rate = np.zeros((len(t), 3))
    rate[:, 2] = -np.radians(10)  # to the right
    gyro = lf.AngularRate(t, rate)
    out = run_node(IntegratedHeading, None, compass=compass, mode=mode, gyro=gyro)
    expected = [350, 350, 350, 350, 355, 0, 5, 10, 15, 20, 350, 350]
    np.testing.assert_allclose(np.degrees(out["heading"].heading) % 360, expected, atol=1e-9)
    status = out["status"]
    assert status.compass_agrees.tolist() == [1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 1, 1]
    alone = np.array([0, 0, 0, 0, 0.5, 1, 1.5, 2, 2.5, 3, 0, 0])
    np.testing.assert_allclose(np.degrees(status.sigma), np.hypot(1.2, 0.05 * alone))
