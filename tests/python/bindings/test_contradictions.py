"""Groups of constraints that end far from what they say are named, with what holds them; others are not."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import own_cameras
import sfmcpp
from sfmcpp import ConstraintGroup, Problem, ResidualGroup

ALL = np.arange(8)


def scene(camera_model: str = "calibrated") -> tuple[Problem, Problem]:
    truth = sfmcpp.circle_scene(8, 60, camera_model=camera_model, seed=0)
    return truth, sfmcpp.perturb(
        truth, point_sigma_m=0.1, position_sigma_m=0.1, rotation_sigma_deg=1.0, seed=0
    )


def positions(truth: Problem, aside_m: float, name: str, sigma: float = 1e-3, **more: Any) -> ConstraintGroup:
    centres = truth.centres + np.array([aside_m, 0.0, 0.0])
    return ConstraintGroup("position", ALL, centres, sigma=sigma, name=name, **more)


def told(problem: Problem, *groups: Any, **options: Any) -> list[str]:
    summary = sfmcpp.solve(problem, constraints=groups, **options)
    assert summary.converged or options
    return [warning for warning in summary.warnings if "from what it says" in warning]


def test_two_groups_that_contradict_each_other_are_named() -> None:
    truth, start = scene()
    a, b = told(start, positions(truth, 0.0, "first"), positions(truth, 10.0, "second"))
    for warning, name, other in ((a, "first", "second"), (b, "second", "first")):
        assert warning.startswith(f"constraints[{name!r}]: member ")
        assert "ends 5,000 σ from what it says" in warning
        assert f"held by {other!r} (8 members end more than 100 σ away)" in warning


def test_a_group_that_gives_way_is_named_beside_the_one_that_holds_it() -> None:
    truth, start = scene()
    (warning,) = told(
        start, positions(truth, 0.0, "loose", sigma=0.01), positions(truth, 10.0, "tight", 1e-5)
    )
    assert "'loose'" in warning
    assert "1,000 σ" in warning
    assert "held by 'tight'" in warning


def test_two_positions_of_one_camera_are_in_the_frame_of_all() -> None:
    truth, start = scene()
    group = ConstraintGroup("position", [0, 0], truth.centres[[0, 0]], sigma=0.1)
    assert not [w for w in sfmcpp.solve(start, constraints=[group]).warnings if "frame of the cameras" in w]
    far = ConstraintGroup("position", [0, 0], truth.centres[[0, 0]] + 1e4, sigma=0.1)
    (warning,) = (w for w in sfmcpp.solve(start, constraints=[far]).warnings if "frame of the cameras" in w)
    assert "1.73e+04 from the cameras" in warning


def test_members_of_one_group_that_contradict_each_other() -> None:
    truth, start = scene()
    twice = ConstraintGroup(
        "position", [3, 3], np.stack([truth.centres[3], truth.centres[3] + 1.0]), sigma=1e-3, name="gps"
    )
    (warning,) = told(start, twice)
    assert "held by its other members" in warning


def test_one_gross_error_among_many_is_held_by_the_images() -> None:
    truth, start = scene()
    group = positions(truth, 0.0, "gps", 0.01)
    assert group.values is not None
    group.values[5] += 10.0
    (warning,) = told(start, group)
    assert "member 5 ends" in warning
    assert "held by the images" in warning


def test_what_is_fixed_holds() -> None:
    truth, start = scene()
    start.fixed_cameras = np.ones(8, dtype=bool)
    start.cameras[:] = truth.cameras
    (warning,) = told(start, positions(truth, 1.0, "gps"))
    assert "1,000 σ" in warning
    assert "held by what is fixed" in warning


@pytest.mark.parametrize("loss", ["tukey", "geman-mcclure", "truncated"])
def test_of_a_group_with_a_robust_loss_the_median_member_counts(loss: str) -> None:
    truth, start = scene()
    apart = positions(truth, 10.0, "apart", loss=loss)
    (warning,) = told(start.copy(), positions(truth, 0.0, "true"), apart)
    assert warning.startswith("constraints['apart']: its median member ends ")
    outliers = positions(truth, 0.0, "true", 0.05, loss=loss)
    assert outliers.values is not None
    outliers.values[:2] += 50.0
    assert told(truth.copy(), outliers) == []


@pytest.mark.parametrize("scale", [0.2, 1.0, None])
@pytest.mark.parametrize("loss", ["tukey", "geman-mcclure", "truncated"])
def test_a_group_that_its_loss_has_let_go_of_is_named_at_every_scale(loss: str, scale: float | None) -> None:
    truth, start = scene()
    far = positions(truth, 0.0, "far", sigma=0.01, loss=loss, loss_scale=scale)
    assert far.values is not None
    far.values[:] += np.random.default_rng(0).normal(0, 50.0, far.values.shape)  # no frame of any model
    (warning,) = told(start, far)
    assert warning.startswith("constraints['far']: its median member ends")


def test_own_residuals_and_own_cameras() -> None:
    truth, start = scene("bal")
    start = replace(start, camera_model=own_cameras.own_bal())

    def apart(poses: np.ndarray) -> np.ndarray:
        return (poses[:, :, 3] - truth.centres - [1.0, 0.0, 0.0]) * 1e3

    own = ResidualGroup(apart, cameras=ALL, name="own")
    warnings = told(start, own, positions(truth, 0.0, "gps"))
    assert any("'own'" in w and "held by 'gps'" in w for w in warnings)


@pytest.mark.parametrize("seed", range(3))
def test_groups_that_agree_are_not_named(seed: int) -> None:
    truth, start = scene()
    rng = np.random.default_rng(seed)
    group = positions(truth, 0.0, "gps", 0.02)
    assert group.values is not None
    group.values += rng.normal(0, 0.06, group.values.shape)
    turned = ConstraintGroup("orientation", ALL, truth.rotations, sigma=1e-3, name="compass")
    assert told(start, group, turned) == []


def test_a_solve_that_has_not_ended_tells_nothing_of_its_groups() -> None:
    truth, start = scene()
    assert told(start, positions(truth, 10.0, "gps"), max_iterations=0) == []


def test_of_many_groups_only_the_first_are_told_in_full() -> None:
    truth, start = scene()
    groups = [positions(truth, 10.0 * k, f"gps {k}") for k in range(20)]
    summary = sfmcpp.solve(start, constraints=groups)
    found = [warning for warning in summary.warnings if warning.startswith("constraints")]
    assert len(found) == 9
    assert found[-1] == "constraints: 12 more groups end as far from what they say"
