"""Which true pose belongs to which image: by names, parts of names, times, numbers and order."""

from __future__ import annotations

import numpy as np
import pytest

from model_helpers import named, true_poses
from sfmcpp import InvalidArgument
from sfmcpp.model import Trajectory
from sfmcpp.study.evaluation import ImagePoses
from sfmcpp.study.evaluation.image_poses import match_by_name, match_with_trajectory


def drive(count: int = 20, stamped: bool = True, start_s: float = 0.0) -> Trajectory:
    t_s = start_s + 0.1 * np.arange(count) if stamped else np.arange(count, dtype=np.float64)
    return Trajectory(t_s, true_poses(count), stamped)


def images(*names: str) -> ImagePoses:
    return ImagePoses(names, true_poses(len(names)))


@pytest.mark.parametrize(
    ("ours", "true", "rule"),
    [
        (("b.jpg", "a.jpg"), ("a.jpg", "b.jpg"), "name"),
        (("photos/b.jpg", "photos/a.jpg"), ("a.jpg", "b.jpg"), "file name"),
        (("x/B.JPG", "x/A.JPG"), ("a.png", "b.png"), "stem"),
        # Names that only differ by their folder tell which is which; those of the files do not.
        (("left/b.jpg", "left/a.jpg", "right/a.jpg"), ("left/a.jpg", "left/b.jpg"), "name"),
        # Letters with accents are the same in either form of Unicode.
        (("\u00e9.jpg", "b.jpg"), ("b.jpg", "e\u0301.jpg"), "file name"),
        # One image has the same whole name, but all have the same stems.
        (("b.jpg", "a.png"), ("a.jpg", "b.jpg"), "stem"),
    ],
)
def test_the_strictest_rule_that_pairs_most_names_is_taken(
    ours: tuple[str, ...], true: tuple[str, ...], rule: str
) -> None:
    found = match_by_name(images(*ours), images(*true))
    assert found.matched_by == rule
    assert found.truth_rows.tolist() == [0, 1]
    assert found.model_rows.tolist() == [1, 0]


def test_ambiguous_file_names_match_nothing() -> None:
    with pytest.raises(InvalidArgument, match="no image of the model is in it"):
        match_by_name(images("left/a.jpg", "right/a.jpg"), images("a.jpg", "b.jpg"))


@pytest.mark.parametrize(("unit", "start_s"), [(1.0, 1305031102.0), (1e-9, 1403636579.0), (1e-6, 50.0)])
def test_names_that_are_times_find_their_poses(unit: float, start_s: float) -> None:
    truth = drive(start_s=start_s)
    rows = [7, 3, 12]
    shown = [(truth.t_s[row] + 0.003) / unit for row in rows]
    names = [f"{s:.6f}.png" if unit == 1 else f"cam0/{round(s)}.png" for s in shown]
    found = match_with_trajectory(images(*names), truth)
    assert found.matched_by == "time"
    assert dict(zip(found.model_rows.tolist(), found.truth_rows.tolist(), strict=True)) == {0: 1, 1: 0, 2: 2}
    np.testing.assert_array_equal(found.truth.poses, truth.poses[sorted(rows)])
    assert "left out" in found.note


def test_a_pose_is_given_to_the_nearest_of_its_images_only() -> None:
    truth = drive(start_s=100.0)
    found = match_with_trajectory(images("100.104.png", "100.099.png", "100.5.png"), truth)
    assert found.truth.names == ("100.099.png", "100.5.png")
    assert len(match_with_trajectory(images("100.104.png", "100.6.png"), truth, None, 0.001).truth) == 1


def test_known_images_without_a_pose_in_the_model_are_missing() -> None:
    truth = drive(start_s=100.0)
    known = ["100.0.png", "100.1.png", "100.2.png", "7000.0.png"]
    found = match_with_trajectory(images("100.0.png", "100.2.png"), truth, known)
    assert found.truth.names == ("100.0.png", "100.1.png", "100.2.png")
    assert (found.truth_rows.tolist(), found.note) == ([0, 2], "")


def test_frame_numbers_are_rows_and_all_other_poses_are_missing() -> None:
    found = match_with_trajectory(images("000004.png", "000002.png"), drive(6, stamped=False))
    assert found.matched_by == "frame number"
    assert found.truth_rows.tolist() == [2, 4]
    assert found.truth.names == ("pose 0", "pose 1", "000002.png", "pose 3", "000004.png", "pose 5")


@pytest.mark.parametrize("stamped", [True, False])
def test_as_many_images_as_poses_are_matched_in_the_order_of_their_numbers(stamped: bool) -> None:
    names = [f"frame_{number}.png" for number in (10, 9, 8, 11)]
    found = match_with_trajectory(images(*names), drive(4, stamped))
    assert found.matched_by == "order"
    assert found.truth.names == ("frame_8.png", "frame_9.png", "frame_10.png", "frame_11.png")
    assert found.model_rows.tolist() == [2, 1, 0, 3]


def test_frame_numbers_are_not_taken_for_the_seconds_of_a_truth_with_times() -> None:
    """Ten poses a second: frame 2 is row 2, at 0.2 s, not the pose at 2 s."""
    found = match_with_trajectory(images("000000.png", "000001.png", "000002.png"), drive(30))
    assert (found.matched_by, found.truth_rows.tolist()) == ("frame number", [0, 1, 2])


@pytest.mark.parametrize("stem", ["0_{}", "nan", "inf"])
def test_words_that_python_takes_for_numbers_are_no_times(stem: str) -> None:
    """Image 0_20 was taken for the one at 20 s."""
    truth = drive(40)
    names = [f"{stem.format(number)}/{stem.format(number)}.png" for number in range(3)]
    if "{}" not in stem:
        names = [f"{stem}.png", "1.5.png"]
    with pytest.raises(InvalidArgument, match=r"40 poses cannot be told to belong to"):
        match_with_trajectory(images(*names), truth)


@pytest.mark.parametrize("names", [("a.png", "b.png"), ("0.png", "700.png")])
def test_names_that_tell_no_pose_are_refused(names: tuple[str, ...]) -> None:
    with pytest.raises(InvalidArgument, match=r"6 poses cannot be told to belong to 2 images such as"):
        match_with_trajectory(images(*names), drive(6, stamped=False))


def test_order_does_not_depend_on_how_the_model_lists_its_images() -> None:
    truth, ours = drive(9, stamped=False), named(true_poses(9), "{}.png")
    turned = ImagePoses(ours.names[::-1], ours.poses[::-1])
    one, other = (match_with_trajectory(model, truth).truth for model in (ours, turned))
    assert one.names == other.names
