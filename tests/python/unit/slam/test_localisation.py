"""Poses without a map: going on as before."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sfmcpp.model.frames import View
from sfmcpp.slam import Frame, Path, WorldMap


def path_of(poses: dict[int, np.ndarray], *t_s: float) -> Path:
    """A path with these poses, of frames at these times."""
    return Path(poses, dict(enumerate(t_s)))


def screw(count: int) -> dict[int, np.ndarray]:
    """Poses of a body that turns and advances by the same amount at every step, in its own axes."""
    turn, advance = Rotation.from_rotvec([0.05, -0.12, 0.3]), np.array([0.2, -0.1, 1.5])
    rotation, centre = Rotation.from_rotvec([0.4, 0.2, -1.0]), np.array([3.0, 2.0, -1.0])
    poses = {}
    for frame in range(count):
        poses[frame] = np.column_stack([rotation.as_matrix(), centre])
        centre = centre + rotation.apply(advance)
        rotation = rotation * turn
    return poses


def test_a_constant_motion_goes_on_exactly() -> None:
    poses = screw(6)
    expected = poses.pop(5)
    found = path_of(poses, 0.0, 0.1, 0.2, 0.3, 0.4).predict(0.5)
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_a_straight_motion_goes_on_in_proportion_to_time() -> None:
    start, now = np.eye(3, 4), np.eye(3, 4)
    now[:, 3] = [0.1, 0.0, 0.4]
    found = path_of({0: start, 1: now}, 1.0, 1.2).predict(1.9)
    np.testing.assert_allclose(found[:, 3], [0.45, 0.0, 1.8])
    np.testing.assert_allclose(found[:, :3], np.eye(3), atol=1e-15)


def test_a_single_pose_stays() -> None:
    pose = screw(1)[0]
    np.testing.assert_array_equal(path_of({0: pose}, 0.0).predict(0.1), pose)


def test_the_speed_is_the_median_of_the_last_steps() -> None:
    centres = [0.0, 50.0, 51.0, 52.0, 53.0, 153.0, 154.0]
    poses = {k: np.column_stack([np.eye(3), [x, 0, 0]]) for k, x in enumerate(centres)}
    times = 0.5 * np.arange(7)
    assert path_of(poses, *times).speed() == pytest.approx(2.0)
    assert path_of(poses, *times).speed(without=[6]) == pytest.approx(2.0)
    assert path_of({0: poses[0]}, *times).speed() == 0.0


class Counted(dict[int, np.ndarray]):
    """Poses that count how often they are asked for."""

    asked = 0

    def __contains__(self, key: object) -> bool:
        self.asked += 1
        return super().__contains__(key)

    def __iter__(self) -> Iterator[int]:
        self.asked += len(self)
        return super().__iter__()


def test_the_latest_poses_cost_the_same_however_long_the_path_is() -> None:
    poses = Counted({k: np.column_stack([np.eye(3), [float(k), 0, 0]]) for k in range(10_000)})
    found = path_of(poses, *np.arange(10_000.0))
    assert list(found.latest(3, without=[9_998])) == [9_996, 9_997, 9_999]
    assert found.speed() == pytest.approx(1.0)
    assert list(found.since(9_998)) == [9_998, 9_999]
    assert poses.asked < 20


def test_the_pose_of_a_frame_is_that_of_the_map_where_it_is_a_keyframe() -> None:
    poses, world = screw(5), WorldMap(np.array([400.0, 1.0, 320.0, 240.0, 0.0]))
    for frame in (0, 3):
        world.add(Frame(frame, float(frame), View(np.arange(2), np.zeros((2, 2)))), poses[frame])
    found = Path({k: poses[k] for k in (1, 2, 4)}, dict(enumerate(np.arange(5.0))), world)
    assert list(found.since(0)) == sorted(found.poses)
    for frame, pose in poses.items():
        np.testing.assert_array_equal(found.pose_of(frame), pose)
        np.testing.assert_array_equal(found.since(0)[frame], pose)
