"""What constraints a solve refuses, and how it says so."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import sfmcpp
from constrained import random_group, scene
from sfmcpp import ConstraintGroup, InvalidArgument, _core
from sfmcpp.weighting import PoseConstraint


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"kind": "gps", "cameras": [0]}, "kind = 'gps': must be one of pose, position"),
        ({"kind": "position", "cameras": [0]}, r"constraints\['position'\].values: missing"),
        (
            {"kind": "position", "cameras": [0], "values": [[1, 2]]},
            r"values: shape \(1, 2\), must be \(1, 3\)",
        ),
        (
            {"kind": "position", "cameras": [0], "values": [[1, 2, np.nan]]},
            r"values\[0, 2\] = nan: must be finite",
        ),
        (
            {"kind": "position", "cameras": [[0, 1]], "values": [[1, 2, 3]]},
            r"cameras: shape \(1, 2\), must be",
        ),
        ({"kind": "scale", "cameras": [0], "values": [1]}, r"cameras: shape \(1,\), must be \(any, 2\)"),
        ({"kind": "scale", "cameras": [[0.0, 1.0]], "values": [1]}, "cameras: dtype float64"),
        ({"kind": "smoothing", "cameras": [[0, 1]], "values": [1]}, "'smoothing' has none"),
        ({"kind": "focal", "cameras": [[0, 1]], "values": [1]}, "between two cameras has none"),
        ({"kind": "smoothing-reprojections", "cameras": [[0, 1]]}, "points: 0 arrays, .* needs 1"),
        ({"kind": "smoothing", "cameras": [[0, 1]], "points": [np.zeros((1, 3))]}, "points: 1 arrays"),
        (
            {"kind": "smoothing", "cameras": [[0, 1]], "member_weights": [1, 2], "name": "a"},
            r"\['a'\].member_w",
        ),
    ],
)
def test_a_group_of_the_wrong_shape_is_refused_when_it_is_made(
    arguments: dict[str, Any], message: str
) -> None:
    with pytest.raises(InvalidArgument, match=message):
        ConstraintGroup(**arguments)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            {"kind": "position", "cameras": [6], "values": [[1, 2, 3]]},
            r"\['position'\]\[0\].cameras: camera 6",
        ),
        (
            {"kind": "position", "cameras": [0], "values": [[1, 2, 3]], "weight": -1.0},
            r"weight = -1.0+: must",
        ),
        (
            {"kind": "orientation", "cameras": [0], "values": [2 * np.eye(3)]},
            r"\[0\].rotation: must be a rot",
        ),
        ({"kind": "scale", "cameras": [[1, 1]], "values": [1]}, r"\['scale'\]\[0\].cameras: camera 1 twice"),
        ({"kind": "focal", "cameras": [0], "values": [-5]}, "a focal length must be positive"),
    ],
)
def test_a_group_that_breaks_a_rule_is_refused_by_the_solve(arguments: dict[str, Any], message: str) -> None:
    problem = scene()
    before = problem.copy()
    with pytest.raises(InvalidArgument, match=message):
        sfmcpp.solve(problem, constraints=[ConstraintGroup(**arguments)])
    np.testing.assert_array_equal(problem.cameras, before.cameras)


def test_two_groups_of_one_name_are_refused() -> None:
    problem = scene()
    groups = [random_group(problem, "scale", name="a"), random_group(problem, "position", name="a")]
    with pytest.raises(InvalidArgument, match=r"constraints\['a'\]: two groups"):
        sfmcpp.solve(problem, constraints=groups)


def test_cameras_that_have_no_pose_or_no_free_focal_length_are_refused() -> None:
    projective = sfmcpp.as_projective(scene("calibrated"))
    gps = ConstraintGroup("position", [0], np.zeros((1, 3)))
    with pytest.raises(InvalidArgument, match="camera_model = 'projective'"):
        sfmcpp.solve(projective, constraints=[gps])
    focal = ConstraintGroup("focal", [0], [800.0])
    with pytest.raises(InvalidArgument, match="'calibrated' has no such free parameter"):
        sfmcpp.solve(scene("calibrated"), constraints=[focal])
    with pytest.raises(InvalidArgument, match=r"constraints\['focal'\]\[0\]: camera 0 keeps its f fixed"):
        sfmcpp.solve(scene().set_free_intrinsics("k1"), constraints=[focal])


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("values", np.ones((5, 1000)), r"values: shape \(5, 1000\), must be \(3, 3\)"),
        ("values", np.zeros((1, 3)), r"values: shape \(1, 3\), must be \(3, 3\)"),
        ("values", np.zeros((9, 1)), r"values: shape \(9, 1\), must be \(3, 3\)"),
        ("values", [[1], [2, 3]], "values = .*: must be an array of numbers"),
        ("values", None, "values: missing"),
        ("member_weights", np.ones(4), r"member_weights: shape \(4,\), must be \(3\)"),
        ("cameras", np.array([1]), r"values: shape \(3, 3\), must be \(1, 3\)"),
        ("cameras", np.arange(3) + 2**32, "cameras: value 4294967298 does not fit in 32 bits"),
        ("cameras", [-(2**31), 2**31, 0], "cameras: value 2147483648 does not fit in 32 bits"),
        ("cameras", [[0], [1, 2]], "cameras = .*: must be an array of numbers"),
        ("points", [np.zeros((2, 3))], "points: 1 arrays, kind 'position' of 3 members needs 0"),
        ("weight", "auto", r"weight = 'auto': must be a number; solve\(…, weight=…\) chooses it"),
        ("loss_scale", "wide", "loss_scale = 'wide': must be a number"),
    ],
)
def test_fields_that_no_longer_fit_each_other_are_refused_by_the_solve(
    field: str, value: Any, message: str
) -> None:
    problem = scene()
    group = random_group(problem, "position", name="gps")
    setattr(group, field, value)
    with pytest.raises(InvalidArgument, match=message):
        sfmcpp.solve(problem, constraints=[group])


def test_points_of_three_numbers_each_are_wanted_by_the_solve() -> None:
    problem = scene()
    group = random_group(problem, "orientation-reprojections", name="gyro")
    group.points = [*group.points[:2], np.zeros((2, 4))]
    with pytest.raises(InvalidArgument, match=r"points\[2\]: shape \(2, 4\), must be \(any, 3\)"):
        sfmcpp.solve(problem, constraints=[group])


def test_what_is_no_group_is_named() -> None:
    with pytest.raises(InvalidArgument, match=r"constraints\[0\] = 1: must be a ConstraintGroup"):
        sfmcpp.solve(scene(), constraints=[1])  # type: ignore[list-item]


def test_a_constraint_on_intrinsics_is_none_on_one_pose() -> None:
    arrays = PoseConstraint("position").arrays(1.0) | {"kind": "focal"}
    view = {"camera_model": "calibrated", "intrinsics": np.array([1.0, 1, 0, 0, 0])}
    view |= {"points": np.tile([0.0, 0, 5], (4, 1)), "pixels": np.zeros((4, 2))}
    view |= {"sigma_px": None, "covariance_px2": None}
    with pytest.raises(InvalidArgument, match=r"kind = 'focal': must be a constraint on poses"):
        _core.refine_pose(view, [arrays], np.eye(3, 4), _core.PoseSweepOptions())


@pytest.mark.parametrize("weight", [None, "auto"])
def test_a_measurement_that_is_no_number_is_named_however_weights_are_chosen(weight: str | None) -> None:
    problem = scene()
    group = random_group(problem, "position", name="gps")
    assert group.values is not None
    group.values[1, 2] = np.nan
    with pytest.raises(InvalidArgument, match=r"\['gps'\].*must be finite"):
        sfmcpp.solve(problem, constraints=[group], weight=weight)
