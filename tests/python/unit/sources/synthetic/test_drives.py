"""Drives with sensors: what the sensors say integrates to the truth, and the scenes are what they claim."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from sfmcpp.errors import InvalidArgument
from sfmcpp.sensors import Mounting, orientations, travelled_distance
from sfmcpp.sources.synthetic import DRIVES, BodySensors, SyntheticDrive, Tracker, table_walk, vehicle_drive
from sfmcpp.sources.synthetic.table_walk import Boxes

Array = NDArray[np.float64]
EXACT = Tracker(200, sigma_px=0.0, drift_px=0.0, loss=0.0, sliding=0.0)
PERFECT = BodySensors(
    odometer_sigma_m_s=0.0,
    odometer_scale=1.0,
    gyro_sigma_deg_s=0.0,
    gyro_bias_deg_s=0.0,
    navigation_sigma_deg=0.0,
)
SMALL = {"vehicle": {"length_m": 60.0, "frame_hz": 10.0}, "table-walk": {"length_m": 2.0, "seconds": 10.0}}


def small(name: str, **options: object) -> SyntheticDrive:
    return DRIVES[name](**{**SMALL[name], **options})


@pytest.fixture(scope="module", params=DRIVES)
def perfect(request: pytest.FixtureRequest) -> SyntheticDrive:
    return small(request.param, tracker=EXACT, sensors=PERFECT)


def body_rotations(drive: SyntheticDrive) -> Rotation:
    return Rotation.from_matrix(drive.truth.rotations @ drive.camera_from_body)


def test_perfect_rates_and_orientations_are_those_of_the_truth(perfect: SyntheticDrive) -> None:
    true = body_rotations(perfect)
    for stream, tolerance_rad in ((perfect.angular_rate, 2e-3), (perfect.orientation, 2e-4)):
        found = Rotation.from_matrix(orientations(stream, perfect.t_s))
        assert ((true[0].inv() * true).inv() * found).magnitude().max() < tolerance_rad


def test_every_track_is_one_point_that_stands_still(perfect: SyntheticDrive) -> None:
    """Without noise the rays of each track meet: the smallest singular value of its rows is rounding."""
    focal_px, _, *centre, _ = perfect.intrinsics
    counts = np.bincount(perfect.track_index)
    for k in np.random.default_rng(0).choice(np.flatnonzero(counts > 5), 30, replace=False):
        rows = np.flatnonzero(perfect.track_index == k)
        rays = np.column_stack([(perfect.pixels[rows] - centre) / focal_px, np.ones(len(rows))])
        poses = perfect.truth.poses[perfect.frame_index[rows]]
        in_world = np.einsum("nij,nj->ni", poses[:, :, :3], rays)
        across = (
            np.eye(3) - np.einsum("ni,nj->nij", in_world, in_world) / np.sum(in_world**2, 1)[:, None, None]
        )
        point = np.linalg.solve(across.sum(axis=0), np.einsum("nij,nj->i", across, poses[:, :, 3]))
        miss = np.linalg.norm(np.einsum("nij,nj->ni", across, point - poses[:, :, 3]), axis=1)
        assert miss.max() < 1e-8


def test_a_perfect_odometer_gives_the_way_of_the_body() -> None:
    drive = small("vehicle", tracker=EXACT, sensors=PERFECT)
    mounting = Mounting(drive.camera_from_body, drive.lever_arm_m)
    centres = mounting.body_poses(drive.truth.poses)[:, :2, 3]
    way_m = np.linalg.norm(np.diff(centres, axis=0), axis=1).sum()
    assert drive.odometer is not None
    found = travelled_distance(drive.odometer, 0.0, float(drive.t_s[-1]))
    np.testing.assert_allclose(found, way_m, rtol=2e-3)


@pytest.mark.parametrize("name", DRIVES)
def test_noise_and_bias_of_the_sensors_are_as_declared(name: str) -> None:
    perfect, noisy = (
        small(name, tracker=EXACT, sensors=s) for s in (PERFECT, BodySensors(gyro_bias_deg_s=0.05))
    )
    rates = np.rad2deg(noisy.angular_rate.values - perfect.angular_rate.values)
    np.testing.assert_allclose(rates.std(axis=0), 0.1, rtol=4 / np.sqrt(2 * len(rates)))
    error = 4 * 0.1 / np.sqrt(len(rates))
    np.testing.assert_allclose(np.linalg.norm(rates.mean(axis=0)), 0.05, atol=2 * error)
    turns = [Rotation.from_rotvec(d.orientation.values) for d in (perfect, noisy)]
    w = np.rad2deg((turns[0].inv() * turns[1]).as_rotvec())
    np.testing.assert_allclose(w.std(), 0.01, rtol=4 / np.sqrt(2 * w.size))
    assert len(rates) == int(100 * noisy.t_s[-1]) + 1 or abs(len(rates) - 100 * noisy.t_s[-1]) < 11


def test_the_odometer_reads_too_much_by_its_scale() -> None:
    perfect, noisy = (small("vehicle", tracker=EXACT, sensors=s) for s in (PERFECT, BodySensors()))
    assert perfect.odometer is not None
    assert noisy.odometer is not None
    error = noisy.odometer.values - 1.01 * perfect.odometer.values
    np.testing.assert_allclose(error.std(), 0.05, rtol=4 / np.sqrt(2 * error.size))
    assert abs(error.mean()) < 4 * 0.05 / np.sqrt(error.size)


def test_the_vehicle_drives_as_far_as_told_turns_round_and_slows_down_for_it() -> None:
    drive = vehicle_drive(130.0, frame_hz=5.0, tracker=EXACT, sensors=PERFECT)
    assert drive.odometer is not None
    np.testing.assert_allclose(travelled_distance(drive.odometer, 0, float(drive.t_s[-1])), 130.0, rtol=0.01)
    ahead = drive.truth.rotations[:, :, 2]
    assert ahead[0] @ ahead[-1] < -0.99
    speeds = drive.odometer.values[:, 0]
    assert speeds.max() > 4.5
    assert 2.4 < speeds[len(speeds) // 2] < 2.7
    assert np.abs(drive.truth.centres[:, 2] - 1.5).max() < 0.2


def test_the_walker_goes_round_the_table_and_looks_at_it() -> None:
    drive = table_walk(8.28, frame_hz=5.0, tracker=EXACT, sensors=PERFECT)
    assert drive.odometer is None
    np.testing.assert_allclose(np.linalg.norm(drive.truth.centres[:, :2], axis=1), 1.4, atol=0.1)
    np.testing.assert_allclose(drive.truth.length_m, 8.28, rtol=0.1)
    to_table = np.array([0, 0, 0.75]) - drive.truth.centres
    along = np.einsum("ni,ni->n", to_table, drive.truth.rotations[:, :, 2]) / np.linalg.norm(to_table, axis=1)
    assert np.degrees(np.arccos(along)).max() < 10


@pytest.mark.parametrize("name", DRIVES)
def test_the_same_seed_gives_the_same_drive(name: str) -> None:
    one, same, other = (small(name, seed=seed) for seed in (2, 2, 3))
    np.testing.assert_array_equal(one.pixels, same.pixels)
    np.testing.assert_array_equal(one.angular_rate.values, same.angular_rate.values)
    assert not np.array_equal(one.angular_rate.values, other.angular_rate.values)


@pytest.mark.parametrize("name", DRIVES)
def test_the_noise_of_the_tracker_leaves_the_way_and_the_sensors_alone(name: str) -> None:
    exact, noisy = small(name, tracker=EXACT), small(name)
    np.testing.assert_array_equal(exact.truth.poses, noisy.truth.poses)
    np.testing.assert_array_equal(exact.orientation.values, noisy.orientation.values)


def test_boxes_hide_what_a_fine_sampling_of_the_line_of_sight_says() -> None:
    boxes = Boxes(np.array([[0.0, 0.0, 0.0], [2.0, -1.0, 0.0]]), np.array([[1.0, 1.0, 1.0], [2.5, 0.5, 2.0]]))
    rng = np.random.default_rng(0)
    eye, points = np.array([-1.0, -0.7, 1.3]), rng.uniform([-1, -2, 0], [4, 2, 2], (500, 3))
    places = eye + (np.arange(3000)[:, None, None] + 0.5) / 3000 * (points - eye)
    inside = [
        ((places > low) & (places < high)).all(axis=2)
        for low, high in zip(boxes.lower, boxes.upper, strict=True)
    ]
    share = np.any(inside, axis=0).mean(axis=0)
    clear = (share == 0) | (share > 0.01)
    np.testing.assert_array_equal(boxes.hides(eye, points)[clear], (share > 0)[clear])
    assert 50 < np.count_nonzero(share) < 450
    assert clear.mean() > 0.9


def test_of_a_box_one_sees_the_sides_that_face_the_eye() -> None:
    box = Boxes(np.zeros((1, 3)), np.ones((1, 3)))
    points = box.surface_points(200.0, np.random.default_rng(1))
    assert len(points) == 1000
    seen = points[~box.hides(np.array([3.0, 0.5, 0.5]), points)]
    np.testing.assert_allclose(seen[:, 0], 1.0)
    assert len(seen) == 200


def test_a_drive_whose_camera_sees_nothing_has_no_tracks() -> None:
    drive = vehicle_drive(60.0, max_depth_m=0.01, frame_hz=5.0)
    assert drive.num_tracks == len(drive.frame_index) == len(drive.track_index) == len(drive.pixels) == 0
    assert len(drive.truth) == len(drive.t_s) > 50


@pytest.mark.parametrize(
    ("make", "options"),
    [
        (vehicle_drive, {"length_m": 40.0}),
        (vehicle_drive, {"speed_m_s": 0.0}),
        (table_walk, {"seconds": -1.0}),
        (table_walk, {"radius_m": np.nan}),
        (vehicle_drive, {"seed": None}),
        (vehicle_drive, {"tracker": 5}),
        (table_walk, {"seed": "a"}),
        (table_walk, {"image_size": 640}),
        (BodySensors, {"gyro_hz": 0.0}),
        (BodySensors, {"navigation_sigma_deg": -1.0}),
    ],
)
def test_what_cannot_be_is_refused(make: object, options: dict[str, object]) -> None:
    with pytest.raises(InvalidArgument, match=next(iter(options))):
        make(**options)  # type: ignore[operator]
