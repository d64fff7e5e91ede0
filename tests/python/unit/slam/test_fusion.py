"""The weight of a new keyframe's constraints, its pose, and all constraints of a window."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from sfmcpp.model.frames import View
from sfmcpp.sensors import Mounting, SensorStream
from sfmcpp.slam import Frame, Gyroscope, Measurement, SlamResult, SlamSettings, WorldMap, result
from sfmcpp.slam.between_keyframes import fit_latest_frame
from sfmcpp.slam.fusion import (
    constraint_groups,
    fuse,
    pose_constraint,
    presumed_weights,
    usual_weights,
)
from sfmcpp.slam.result import KeyframeRecord
from sfmcpp.slam.world_map import WeightedMeasurement
from slam_helpers import INTRINSICS, project, small_map

SETTINGS = SlamSettings()
PREVIOUS = np.column_stack([Rotation.from_rotvec([0.02, 0.1, 0]).as_matrix(), [0.2, 0.1, -0.1]])
TRUE = np.column_stack([Rotation.from_rotvec([0.01, 0.15, 0.02]).as_matrix(), [0.9, 0.0, 0.3]])
DISTANCE = float(np.linalg.norm(TRUE[:, 3] - PREVIOUS[:, 3]))


def map_and_view(sigma_px: float = 0.7, points: int = 60) -> tuple[WorldMap, View]:
    """A map of one keyframe with exact points, and what the next frame sees of them."""
    rng = np.random.default_rng(3)
    cloud = rng.uniform([-3, -2, 6], [3, 2, 12], (points, 3))
    tracks = np.arange(points, dtype=np.int32)
    world = WorldMap(INTRINSICS)
    world.add(Frame(0, 0.0, View(tracks, project(PREVIOUS, cloud))), PREVIOUS)
    world.points[:] = cloud
    return world, View(tracks, project(TRUE, cloud) + rng.normal(0, sigma_px, (points, 2)))


def scale(distance: float, *, doubtful: bool = False, sensor: str = "odometer") -> Measurement:
    return Measurement(sensor, "scale", distance, 0.02, doubtful)


def remember(world: WorldMap, sensor: str, *weights: float) -> None:
    """Let the last keyframe have constraints with these weights."""
    world.keyframes[-1].constraints += [WeightedMeasurement(scale(1.0, sensor=sensor), w) for w in weights]


def best_pose(world: WorldMap, view: View, distance: float, weight: float) -> np.ndarray:
    """Pose with the least mean squared pixel error plus λ² times the squared error of the distance."""

    def pose_of(x: np.ndarray) -> np.ndarray:
        turn = TRUE[:, :3] @ Rotation.from_rotvec(x[:3]).as_matrix()
        return np.column_stack([turn, TRUE[:, 3] + x[3:]])

    def cost(x: np.ndarray) -> float:
        pose = pose_of(x)
        pixels = ((project(pose, world.points[view.tracks]) - view.pixels) ** 2).sum(axis=1).mean()
        return float(pixels + weight**2 * (np.linalg.norm(pose[:, 3] - PREVIOUS[:, 3]) - distance) ** 2)

    return pose_of(minimize(cost, np.zeros(6), method="BFGS", options={"gtol": 1e-9}).x)


def test_the_pose_fits_the_images_and_the_weighted_measurement() -> None:
    world, view = map_and_view()
    fused = fuse(world, view, TRUE, [scale(DISTANCE + 0.003)], SETTINGS)
    (constraint,) = fused.constraints
    assert constraint.weight > 0
    assert constraint.weight == fused.selections[0].weight
    expected = best_pose(world, view, DISTANCE + 0.003, constraint.weight)
    np.testing.assert_allclose(fused.pose, expected, atol=2e-6)
    # It is not the pose that the images alone would have.
    assert np.abs(fused.pose - best_pose(world, view, 0.0, 0.0)).max() > 2e-5


def test_what_the_pose_does_not_explain_takes_no_part() -> None:
    world, view = map_and_view()
    wild = View(view.tracks, view.pixels.copy())
    wild.pixels[:5] += 40.0
    without = View(view.tracks[5:], view.pixels[5:])
    found = [fuse(world, v, TRUE, [scale(DISTANCE)], SETTINGS).pose for v in (wild, without)]
    np.testing.assert_array_equal(*found)


@pytest.mark.parametrize("weights", ["none", "loo"])
def test_a_keyframe_without_a_measurement_that_counts_keeps_its_pose(weights: str) -> None:
    world, view = map_and_view()
    measured = [scale(DISTANCE)] if weights == "none" else []
    fused = fuse(world, view, TRUE, measured, SlamSettings(weights=weights))
    assert fused.pose is TRUE
    assert fused.constraints == []


def test_a_doubtful_measurement_gets_no_weight_and_does_not_move_the_pose() -> None:
    world, view = map_and_view()
    fused = fuse(world, view, TRUE, [scale(3 * DISTANCE, doubtful=True)], SETTINGS)
    assert [c.weight for c in fused.constraints] == [0.0]
    np.testing.assert_array_equal(fused.pose, TRUE)


def test_images_that_a_sensor_cannot_be_so_far_from_do_not_make_it_yield() -> None:
    world, view = map_and_view()
    far = scale(DISTANCE + 0.5)
    yielding, held = (
        fuse(world, view, TRUE, [replace(far, reach=reach)], SETTINGS) for reach in (np.inf, 0.1)
    )
    assert yielding.selections[0].conflict.sigmas > 3
    assert (yielding.images_wrong, held.images_wrong) == (False, True)
    assert held.constraints[0].weight > 2 * yielding.constraints[0].weight
    moved, kept = (np.linalg.norm(f.pose[:, 3] - PREVIOUS[:, 3]) for f in (held, yielding))
    assert abs(moved - DISTANCE - 0.5) < abs(kept - DISTANCE - 0.5)


def test_with_too_few_points_to_choose_by_a_sensor_keeps_its_usual_weight() -> None:
    world, view = map_and_view(points=7)
    remember(world, "odometer", 3.0, 5.0, 40.0)
    fused = fuse(world, view, TRUE, [scale(DISTANCE)], SETTINGS)
    assert fused.pose is TRUE
    assert fused.selections == []
    assert [c.weight for c in fused.constraints] == pytest.approx([5.0])


def test_the_usual_weight_is_the_median_of_the_same_sensor_where_it_was_not_doubtful() -> None:
    world, _ = map_and_view()
    remember(world, "odometer", 2.0, 8.0)
    remember(world, "other", 100.0)
    world.keyframes[-1].constraints.append(WeightedMeasurement(scale(1.0, doubtful=True), 0.0))
    asked = [scale(1.0), scale(1.0, doubtful=True), scale(1.0, sensor="new")]
    assert [c.weight for c in usual_weights(world, asked)] == pytest.approx([5.0, 0.0, 1.0])


def test_the_usual_weight_follows_what_the_sensor_may_be_off_by() -> None:
    world, _ = map_and_view()
    remember(world, "odometer", 6.0)
    twice = Measurement("odometer", "scale", 1.0, 2 * 0.02)
    assert [c.weight for c in usual_weights(world, [twice])] == pytest.approx([3.0])


def test_the_usual_weight_is_that_of_lately() -> None:
    """A sensor that has become wrong keeps what conflicts leave it."""
    world, _ = map_and_view()
    remember(world, "odometer", *[50.0] * 20, 7.0, 1.0, 2.0, 3.0, 4.0)
    assert [c.weight for c in usual_weights(world, [scale(1.0)])] == pytest.approx([3.0])


def constrained_map() -> WorldMap:
    """Four keyframes; each but the first says a distance and its place, with weights of its number."""
    world = small_map([[0, 1, 2], [0, 1, 2], [0, 1], [0, 1, 2]])
    for k, keyframe in enumerate(world.keyframes[1:], start=1):
        place = Measurement("gps", "position", np.full(3, float(k)), 1.0)
        keyframe.constraints = [
            WeightedMeasurement(scale(10.0 * k), 2.0 * k),
            WeightedMeasurement(place, 3.0 * k),
        ]
    return world


def test_a_window_has_the_constraints_of_its_free_keyframes() -> None:
    world = constrained_map()
    local = world.around(2)
    assert local.images.tolist() == [0, 1, 2, 3]
    groups = {group.name: group for group in constraint_groups(world, local)}
    assert {name: group.kind for name, group in groups.items()} == {"odometer": "scale", "gps": "position"}
    np.testing.assert_array_equal(groups["odometer"].cameras, [[1, 2], [2, 3]])
    np.testing.assert_array_equal(groups["odometer"].values.ravel(), [20.0, 30.0])
    np.testing.assert_array_equal(groups["gps"].cameras, [2, 3])
    np.testing.assert_array_equal(groups["gps"].values, [[2.0] * 3, [3.0] * 3])


def test_a_constraint_counts_as_often_as_its_keyframe_sees_points() -> None:
    """Sums of squares over N pixels stand beside N λ² (thesis eq. 5.3)."""
    world = constrained_map()
    groups = {group.name: group for group in constraint_groups(world, world.around(2))}
    np.testing.assert_array_equal(groups["odometer"].member_weights, [2 * 4.0**2, 3 * 6.0**2])
    np.testing.assert_array_equal(groups["gps"].member_weights, [2 * 6.0**2, 3 * 9.0**2])


def test_a_motion_whose_start_takes_no_part_is_left_out_and_a_place_is_not() -> None:
    world = constrained_map()
    world.forget(world.keypoints_of([0, 2]))
    local = world.local_problem([3])
    assert local.images.tolist() == [1, 3]
    groups = constraint_groups(world, local)
    assert [group.name for group in groups] == ["gps"]
    np.testing.assert_array_equal(groups[0].cameras, [1])


def test_a_motion_from_a_free_keyframe_that_sees_nothing_any_more_is_left_out() -> None:
    world = constrained_map()
    world.forget(world.keypoints_of([2]))
    local = world.whole_problem()
    assert local.images.tolist() == [0, 1, 2, 3]
    groups = {group.name: group for group in constraint_groups(world, local)}
    assert [1, 2] in groups["odometer"].cameras.tolist()
    assert [2, 3] not in groups["odometer"].cameras.tolist()


def test_a_map_without_sensors_has_no_groups() -> None:
    world = small_map([[0, 1], [0, 1]])
    assert constraint_groups(world, world.around(2)) == []


def test_the_presumed_weight_is_that_of_the_declared_sigma() -> None:
    """N λ² ε is (σ_px / σ)² times the squared error; what declares no σ, or is doubtful, has none."""
    world = small_map([[0, 1, 2, 3], [0, 1, 2, 3]], unknown=(3,))
    before, keyframe = world.keyframes
    turn = Measurement("gyro", "displacement-rotation-log", np.eye(3), 0.001)
    unknown = Measurement("wheel", "scale", 1.0, None)
    asked = [scale(1.0), turn, unknown, scale(1.0, doubtful=True)]
    found = presumed_weights(world, keyframe, before, asked)
    assert [c.measurement for c in found] == asked[:2]
    assert [3 * c.weight**2 for c in found] == pytest.approx([(0.5 / 0.02) ** 2, 3 * (0.5 / 0.001) ** 2])


@pytest.mark.parametrize(
    ("settings", "follows"),
    [
        (SETTINGS, True),
        (SlamSettings(weight_bounds="none"), False),
        (SlamSettings(weights="fixed:20"), False),
    ],
)
def test_a_frame_between_keyframes_follows_sensors_only_where_they_declare(
    settings: SlamSettings, follows: bool
) -> None:
    world, view = map_and_view()
    remember(world, "odometer", 50.0)
    told = fit_latest_frame(world, view, TRUE, [scale(DISTANCE + 0.05)], settings)
    if not follows:
        assert told is TRUE
        return
    expected = best_pose(world, view, DISTANCE + 0.05, 50.0)
    np.testing.assert_allclose(told, expected, atol=1e-4)


def test_what_shaken_rates_may_be_off_judges_a_conflict_and_a_quarter_bounds_the_weight() -> None:
    shaken = np.random.default_rng(0).normal(0, 0.02, (41, 3))
    mounting = Mounting(np.eye(3), np.zeros(3))
    strict, lax = (
        Gyroscope(SensorStream(np.arange(41) / 10, rates, "angular_rate"), mounting).measure(0, 4, np.eye(3))
        for rates in (np.zeros((41, 3)), shaken)
    )
    assert strict is not None
    assert lax is not None
    assert (strict.slack, strict.sigma) == (0.0, 0.001)
    assert lax.sigma == pytest.approx(0.25 * lax.slack)
    # Forty steps of a tenth of a second.
    assert lax.slack == pytest.approx(0.1 * 0.02 * np.sqrt(40), rel=0.3)
    assert pose_constraint(lax, PREVIOUS).slack == lax.slack


def test_of_many_keyframes_some_keep_their_curves(monkeypatch: pytest.MonkeyPatch) -> None:
    """They are most of what a keyframe holds, and a plot shows a few."""
    monkeypatch.setattr(result, "_MOST_CURVES", 8)
    curve = [object()]
    found = SlamResult()
    for k in range(100):
        found.record(KeyframeRecord(k, float(k), 10, selections=curve))  # type: ignore[arg-type]
        kept = [record.frame for record in found.records if record.selections]
        assert min(k + 1, 4) <= len(kept) <= 8
        assert len(set(np.diff(kept))) <= 1
    assert kept == list(range(0, 100, 16))
