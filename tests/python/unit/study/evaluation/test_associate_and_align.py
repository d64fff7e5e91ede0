"""Which poses are compared, and how the estimate is brought to the truth."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry.similarity import Similarity
from sfmcpp.model import Trajectory
from sfmcpp.study.evaluation import AlignmentRule, Matched, align, associate, evaluate
from trajectory_helpers import noisy, path


def shifted(trajectory: Trajectory, seconds: float) -> Trajectory:
    return Trajectory(trajectory.t_s + seconds, trajectory.poses)


def rows(*numbers: int) -> np.ndarray:
    return np.array(numbers, dtype=np.int64)


def test_each_pose_meets_the_nearest_in_time_within_the_limit() -> None:
    truth = path()
    keyframes = shifted(truth.at(rows(3, 10, 30, 59)), 0.004)
    pairs = associate(keyframes, truth)
    np.testing.assert_array_equal(pairs.truth.t_s, truth.t_s[[3, 10, 30, 59]])
    np.testing.assert_array_equal(pairs.estimate.t_s, keyframes.t_s)
    swapped = associate(truth, keyframes)
    np.testing.assert_array_equal(swapped.estimate.t_s, truth.t_s[[3, 10, 30, 59]])
    with pytest.raises(InvalidArgument, match=r"no pose within 0.003 s .* from 100.000000 to 105.900000"):
        associate(keyframes, truth, max_difference_s=0.003)


def test_no_pose_is_used_twice() -> None:
    truth = path(3, step_s=1.0)
    dense = Trajectory(np.array([99.9, 100.02, 100.98, 101.3, 102.4]), path(5).poses)
    pairs = associate(dense.at(rows(0, 1, 2)), truth, max_difference_s=0.5)
    np.testing.assert_allclose(pairs.truth.t_s, [100.0, 101.0])
    np.testing.assert_allclose(pairs.estimate.t_s, [100.02, 100.98])


def test_most_poses_without_a_partner_are_warned_of_and_the_advice_finds_them() -> None:
    truth = path(60)  # ten a second
    between = np.where(np.arange(60) % 3 == 0, 0.0, 0.04)  # a third of the poses is near a true one
    estimate = Trajectory(truth.t_s + between, truth.poses)
    found = evaluate(estimate, truth)
    assert found.warning.startswith("only 20 poses are matched, of 59 estimated and 60 true ones while both")
    assert found.to_dict()["warning"] == found.warning
    assert evaluate(estimate, truth, match="interpolate").warning == ""
    assert evaluate(estimate, truth, max_difference_s=0.05).warning == ""
    sparse = evaluate(truth, truth.at(np.arange(0, 60, 7)))  # all that the sparser one has
    assert (len(sparse.estimate), sparse.warning) == (9, "")
    early = evaluate(truth, truth.at(np.arange(25)))  # the rest is at another time
    assert (len(early.estimate), early.warning, early.to_dict()["warning"]) == (25, "", None)


@pytest.mark.parametrize(("factor", "unit"), [(1e3, "milli"), (1e6, "micro"), (1e9, "nano")])
def test_stamps_in_another_unit_are_refused_though_some_fall_on_true_ones(factor: float, unit: str) -> None:
    truth = path(6000, start_s=0.0)  # ten minutes, of which one in 1000 falls on a second
    scaled = Trajectory(truth.t_s * factor, truth.poses)
    for dense, rate in ((truth, 1), (truth.at(np.arange(0, 6000, 20)), 20)):
        with pytest.raises(InvalidArgument, match=f"estimate: lasts 1,.* these seem to be {unit}seconds"):
            associate(scaled, dense, max_difference_s=0.5)
        with pytest.raises(InvalidArgument, match=f"truth: lasts 1,.* these seem to be {unit}seconds"):
            evaluate(dense, scaled.at(np.arange(0, 6000, rate)), match="interpolate")
    part = truth.at(np.arange(300, 306))
    assert len(associate(part, truth)) == 6  # a thousandth of the truth, at its rate


def test_an_interpolated_truth_is_at_the_time_of_the_estimate() -> None:
    times = np.linspace(0, 6, 61)
    circle = Rotation.from_rotvec(np.outer(times, [0, 0, 0.2])).as_matrix()
    truth = Trajectory(times, np.concatenate([circle, np.outer(times, [1, 2, 3])[:, :, None]], axis=2))
    at = np.array([0.033, 2.49, 5.999, 6.2])
    estimate = Trajectory(at, np.tile(np.eye(3, 4), (4, 1, 1)))
    pairs = associate(estimate, truth, "interpolate")
    np.testing.assert_allclose(pairs.truth.t_s, at[:3])
    np.testing.assert_allclose(pairs.truth.centres, np.outer(at[:3], [1, 2, 3]), atol=1e-12)
    angles = Rotation.from_matrix(pairs.truth.rotations).as_rotvec()[:, 2]
    np.testing.assert_allclose(angles, 0.2 * at[:3], atol=1e-12)


def test_a_hole_in_the_truth_is_not_interpolated_over() -> None:
    truth = path(60, start_s=0.0)
    holed = truth.at(np.delete(np.arange(60), np.arange(20, 45)))
    pairs = associate(truth, holed, "interpolate", max_difference_s=0.25)
    np.testing.assert_allclose(pairs.estimate.t_s, np.delete(truth.t_s, np.arange(22, 43)))


def test_poses_without_times_are_paired_in_their_order() -> None:
    truth = path()
    frames = Trajectory(np.arange(60.0), truth.poses, stamped=False)
    assert len(associate(truth, frames)) == 60
    with pytest.raises(InvalidArgument, match="has 60 poses and the estimate 59: must be as many"):
        associate(truth.at(np.arange(59)), frames)


def test_unknown_matches_and_limits_are_refused() -> None:
    with pytest.raises(InvalidArgument, match="match = 'closest'"):
        associate(path(), path(), "closest")
    with pytest.raises(InvalidArgument, match="max_difference_s = -1"):
        associate(path(), path(), max_difference_s=-1.0)


@pytest.mark.parametrize(
    ("text", "pairs", "count"),
    [
        ("all", 50, 50),
        ("none", 50, 0),
        ("first:0.1", 50, 5),
        ("first:0.1", 51, 6),
        ("first:0.1", 12, 3),
        ("first:0.07", 100, 7),
        ("first:0.55", 100, 55),
        ("first:20", 50, 20),
        ("first:20", 15, 15),
    ],
)
def test_a_rule_counts_the_first_pairs(text: str, pairs: int, count: int) -> None:
    rule = AlignmentRule.parse(text)
    assert rule.count(pairs) == count
    assert str(rule) == text


@pytest.mark.parametrize(
    "text", ["some", "first", "first:", "first:0", "first:-1", "first:2", "first:4.5", "last:5"]
)
def test_a_rule_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(InvalidArgument, match="align = "):
        AlignmentRule.parse(text)


def moved(trajectory: Trajectory, scale: float = 0.05) -> Trajectory:
    away = Similarity(scale, Rotation.from_rotvec([1.0, -2.0, 0.5]).as_matrix(), np.array([5.0, 6.0, -7.0]))
    return trajectory.with_poses(away.apply_to_poses(trajectory.poses))


@pytest.mark.parametrize("by", ["positions", "poses"])
@pytest.mark.parametrize("rule", ["all", "first:0.2"])
def test_a_moved_and_scaled_copy_is_brought_back(rule: str, by: str) -> None:
    truth = path()
    aligned, alignment = align(Matched(moved(truth), truth), AlignmentRule.parse(rule), by=by)
    np.testing.assert_allclose(aligned.poses, truth.poses, atol=1e-10)
    assert alignment.similarity.scale == pytest.approx(20.0)


def test_a_rigid_alignment_leaves_the_scale_wrong() -> None:
    truth = path()
    measured = evaluate(moved(truth, 0.5), truth, with_scale=False)
    assert measured.alignment.similarity.scale == 1.0
    assert measured.scale_ratio is not None
    assert measured.scale_ratio.mean == pytest.approx(0.5)
    assert measured.scale_ratio.std == pytest.approx(0.0, abs=1e-12)


def test_without_alignment_nothing_moves() -> None:
    truth = path()
    estimate = moved(truth)
    aligned, alignment = align(Matched(estimate, truth), AlignmentRule.parse("none"))
    np.testing.assert_array_equal(aligned.poses, estimate.poses)
    assert (alignment.count, alignment.with_scale, alignment.warning) == (0, False, "")


def straight_then_bent(sway_m: float = 0.0, count: int = 60) -> Trajectory:
    """Twenty metres straight ahead but for a small sway, then a curve."""
    truth = path(count)
    centres = np.zeros((count, 3))
    centres[:, 0] = np.arange(count)
    centres[:, 2] = sway_m * np.sin(np.arange(count))
    centres[count // 3 :, 1] = 0.1 * np.arange(count - count // 3) ** 1.5
    return truth.with_poses(np.concatenate([truth.rotations, centres[:, :, None]], axis=2))


def test_a_straight_start_is_warned_of_and_aligned_better_by_poses() -> None:
    truth = straight_then_bent(sway_m=0.01)
    estimate = moved(noisy(truth, position_m=0.01, rotation_rad=0.002), 1.0)
    by_positions, by_poses = (
        evaluate(estimate, truth, align_to="first:0.2", align_by=by) for by in ("positions", "poses")
    )
    assert "rotation about their line is hardly determined" in by_positions.alignment.warning
    assert by_poses.alignment.warning == ""
    assert evaluate(estimate, truth).alignment.warning == ""
    assert 3 * by_poses.mean_3d_error_m < by_positions.mean_3d_error_m


def test_an_exactly_straight_start_has_no_alignment_by_positions() -> None:
    truth = straight_then_bent()
    with pytest.raises(InvalidArgument, match="on a line"):
        evaluate(truth, truth, align_to="first:0.2")
    assert evaluate(truth, truth, align_to="first:0.2", align_by="poses").mean_3d_error_m < 1e-10
    with pytest.raises(InvalidArgument, match="by = 'eye'"):
        evaluate(truth, truth, align_by="eye")
