"""KITTI drives, small ones and the seven real ones: what the reader makes of them, lengths, clocks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat, savemat
from scipy.spatial.transform import Rotation

from sfmcpp.errors import DatasetError
from sfmcpp.geometry import so3
from sfmcpp.sensors import (
    Mounting,
    SensorStream,
    Trajectory,
    check_rotations,
    travelled_distance,
)
from sfmcpp.slam import Odometer
from sfmcpp.sources.io.kitti_mat import KittiDrive, read_kitti_mat

DRIVES = [f"2011_09_26_drive_{n}" for n in ("0001", "0005", "0027", "0036", "0039", "0095")]
DRIVES += ["2011_09_30_drive_0020"]


def small_drive(**changes: np.ndarray) -> dict[str, np.ndarray]:
    """Five frames and three tracks, seven samples of the sensors."""
    frames, samples = 5, 7
    rng = np.random.default_rng(0)
    tracks = rng.uniform(0, 300, (4, frames, 3))
    tracks[:, 2, 1] = -1
    content = {
        "y_k_j": tracks,
        "t": 1e9 + 0.1 * np.arange(frames)[None],
        "v_vk_vk_i": rng.uniform(0, 9, (3, samples)),
        "w_vk_vk_i": rng.uniform(-1, 1, (3, samples)),
        "r_i_vk_i": rng.uniform(0, 9, (3, samples)),
        "theta_vk_i": rng.uniform(-1, 1, (3, samples)),
        "C_c_v": Rotation.random(rng=rng).as_matrix(),
        "rho_v_c_v": rng.uniform(-1, 1, (3, 1)),
    }
    content |= {name: np.array([[700.0]]) for name in ("fu", "fv", "cu", "cv", "b")}
    return content | changes


def written(folder: Path, content: dict[str, np.ndarray]) -> Path:
    path = folder / "drive.mat"
    savemat(path, content)
    return path


def test_samples_without_a_time_and_tracks_not_seen_are_left_out(tmp_path: Path) -> None:
    content = small_drive()
    drive = read_kitti_mat(written(tmp_path, content))
    assert (len(drive.velocity), len(drive.angular_rate), len(drive.truth)) == (5, 5, 5)
    np.testing.assert_array_equal(drive.velocity.values, content["v_vk_vk_i"].T[:5] * [1, -1, 1])
    seen = set(zip(drive.frame_index.tolist(), drive.track_index.tolist(), strict=True))
    assert seen == {(f, j) for f in range(5) for j in range(3)} - {(2, 1)}
    row = int(np.flatnonzero((drive.frame_index == 3) & (drive.track_index == 1))[0])
    np.testing.assert_array_equal([*drive.left_px[row], *drive.right_px[row]], content["y_k_j"][:, 3, 1])


def test_a_world_point_is_in_the_true_camera_where_the_layout_says(tmp_path: Path) -> None:
    content = small_drive()
    truth = read_kitti_mat(written(tmp_path, content)).truth
    point = np.array([3.0, -2.0, 11.0])
    for k in range(5):
        back = Rotation.from_rotvec(-content["theta_vk_i"][:, k])
        in_body = back.apply(point - content["r_i_vk_i"][:, k])
        expected = content["C_c_v"] @ (in_body - content["rho_v_c_v"][:, 0])
        found = truth.rotations[k].T @ (point - truth.centres[k])
        np.testing.assert_allclose(found, expected, atol=1e-12)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"t": np.array([[0.0, 0.1, 0.1, 0.2, 0.3]])}, r"stream 'velocity': t_s\[2\] = 0.1 s is a duplicate"),
        ({"t": np.zeros((1, 4))}, r"t has shape \(1, 4\)"),
        ({"w_vk_vk_i": np.full((3, 7), 90.0)}, "stream 'gyro': angular rate of .*degrees"),
        ({"v_vk_vk_i": np.full((3, 7), np.nan)}, r"v_vk_vk_i\[0, 0\] is nan"),
        ({"v_vk_vk_i": np.zeros((3, 6))}, "w_vk_vk_i has shape"),
        ({"C_c_v": np.ones((3, 3))}, "C_c_v is no rotation"),
        ({"fu": np.array(["wide"])}, "fu is text"),
        ({"fu": np.array([[-700.0]])}, "fu is -700: must be positive"),
        ({"fv": np.array([[0.0]])}, "fv is 0: must be positive"),
    ],
)
def test_a_drive_that_cannot_be_is_named(tmp_path: Path, changes: dict[str, np.ndarray], told: str) -> None:
    path = written(tmp_path, small_drive(**changes))
    with pytest.raises(DatasetError, match=told) as caught:
        read_kitti_mat(path)
    assert caught.value.path == str(path)


def test_fewer_samples_than_stamps_are_refused(tmp_path: Path) -> None:
    names = ("v_vk_vk_i", "w_vk_vk_i", "r_i_vk_i", "theta_vk_i")
    content = small_drive(**{name: np.zeros((3, 4)) for name in names})
    with pytest.raises(DatasetError, match="4 samples of v_vk_vk_i for 5 stamps"):
        read_kitti_mat(written(tmp_path, content))


def test_what_is_no_matlab_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "drive.mat"
    content = written(tmp_path, small_drive()).read_bytes()
    for data, told in [(b"hello", "not a MATLAB file"), (content[:500], "MATLAB file|lacks the variables")]:
        path.write_bytes(data)
        with pytest.raises(DatasetError, match=told):
            read_kitti_mat(path)
    savemat(path, {"t": np.zeros((1, 3))})
    with pytest.raises(DatasetError, match="lacks the variables y_k_j, v_vk_vk_i"):
        read_kitti_mat(path)


@pytest.fixture(scope="module", params=DRIVES)
def drive_path(data_dir: Path, request: pytest.FixtureRequest) -> Path:
    return data_dir / "kitti_tracks" / f"{request.param}_sync_KLT.mat"


@pytest.fixture(scope="module")
def drive(drive_path: Path) -> KittiDrive:
    return read_kitti_mat(drive_path)


def body_truth(drive: KittiDrive) -> Trajectory:
    mounting = Mounting(drive.camera_from_body, drive.lever_arm_m)
    return drive.truth.with_poses(mounting.body_poses(drive.truth.poses))


# Velocity and rate alone end 0.7 to 5.3 % off, says the README of the data; it integrates by Euler's rule.
NEAREST_END, FARTHEST_END = 0.007, 0.053


def test_velocities_go_where_the_body_goes(drive: KittiDrive) -> None:
    truth = body_truth(drive)
    turns = np.swapaxes(truth.rotations[:-1], 1, 2) @ truth.rotations[1:]
    halfway = truth.rotations[:-1] @ so3.exp(0.5 * so3.log(turns))
    steps = np.einsum("nji,nj->ni", halfway, np.diff(truth.centres, axis=0))
    told = 0.5 * (drive.velocity.values[1:] + drive.velocity.values[:-1])
    moves = told[:, 0] > 2.0
    sides = [x[moves, 1] / x[moves, 0] for x in (steps, told, told * [1, -1, 1])]
    errors = [np.sqrt(np.mean((side - sides[0]) ** 2)) for side in sides[1:]]
    assert errors[0] < errors[1]


@pytest.mark.real
def test_eulers_rule_ends_exactly_where_the_readme_of_the_data_says(data_dir: Path) -> None:
    ends = []
    for name in DRIVES:
        drive = read_kitti_mat(data_dir / "kitti_tracks" / f"{name}_sync_KLT.mat")
        truth = body_truth(drive)
        turn, position = Rotation.from_matrix(truth.rotations[0]), truth.centres[0]
        for k, dt in enumerate(np.diff(drive.t_s)):
            as_in_file = drive.velocity.values[k] * [1, -1, 1]
            position = position + turn.apply(as_in_file * dt)
            turn = turn * Rotation.from_rotvec(drive.angular_rate.values[k] * dt)
        ends.append(np.linalg.norm(position - truth.centres[-1]) / truth.length_m)
    assert (round(min(ends), 3), round(max(ends), 3)) == (NEAREST_END, FARTHEST_END)


@pytest.mark.real
def test_the_odometer_measures_the_length_of_the_true_path(drive: KittiDrive) -> None:
    truth = body_truth(drive)
    forward = SensorStream(drive.velocity.t_s, drive.velocity.values[:, 0], "speed")
    driven = travelled_distance(forward, drive.t_s[0], drive.t_s[-1])
    assert driven == pytest.approx(truth.length_m, rel=0.03)


@pytest.mark.real
@pytest.mark.parametrize("number", ["0001", "0027", "0036", "0039"])
def test_steps_of_the_odometer_are_a_hundredth_of_the_way_off(data_dir: Path, number: str) -> None:
    drive = read_kitti_mat(data_dir / "kitti_tracks" / f"2011_09_26_drive_{number}_sync_KLT.mat")
    mounting = Mounting(drive.camera_from_body, drive.lever_arm_m)
    odometer = Odometer(drive.velocity, relative_sigma=0.01, mounting=mounting)
    errors, poses = [], drive.truth.poses
    for k in range(0, len(poses) - 10, 2):  # over a second
        turn, way = poses[k, :, :3].T @ poses[k + 10, :, :3], poses[k + 10, :, 3] - poses[k, :, 3]
        told = odometer.measure(drive.t_s[k], drive.t_s[k + 10], poses[k + 10, :, :3], turn)
        assert told is not None
        assert told.sigma is not None
        errors.append((np.asarray(told.value)[:, 3] - poses[k, :, :3].T @ way) / told.sigma)
    assert 0.5 < np.sqrt(np.mean(np.square(errors))) < 1.5


@pytest.mark.real
def test_a_delay_put_on_the_gyroscope_is_found_beside_the_true_rotations(drive: KittiDrive) -> None:
    mounting = Mounting(drive.camera_from_body, drive.lever_arm_m)
    own = check_rotations(drive.angular_rate, mounting, drive.truth)
    delayed = check_rotations(drive.angular_rate.shifted(-0.3), mounting, drive.truth)
    assert own.complaint("gyro") == ""
    assert own.error_rad < 0.5 * own.turned_rad
    assert delayed.is_determined
    assert delayed.offset_s - own.offset_s == pytest.approx(0.3, abs=0.01)
    assert "behind the camera's" in delayed.complaint("gyro")


def reprojection_errors(
    drive: KittiDrive, tracks: np.ndarray, frame: int, here: np.ndarray, there: np.ndarray
) -> np.ndarray:
    """Errors [px] in the next frame of the points that the disparity of this one gives."""
    both = (tracks[:, [frame, frame + 1]] != -1).all(axis=(0, 1))
    both &= tracks[0, frame] - tracks[2, frame] > 3.0
    left, right_u = tracks[:2, frame, both].T, tracks[2, frame, both]
    depth = drive.focal_px[0] * drive.baseline_m / (left[:, 0] - right_u)
    rays = (left - drive.principal_point_px) / drive.focal_px
    points = np.column_stack([rays, np.ones(len(rays))]) * depth[:, None]
    moved = (points @ here[:, :3].T + here[:, 3] - there[:, 3]) @ there[:, :3]
    pixels = drive.focal_px * moved[:, :2] / moved[:, 2:] + drive.principal_point_px
    return np.linalg.norm(pixels - tracks[:2, frame + 1, both].T, axis=1)


@pytest.mark.real
def test_the_true_poses_explain_the_motion_of_the_tracks(drive_path: Path, drive: KittiDrive) -> None:
    """Unlike the same poses the wrong way round, which are worse than no motion at all."""
    tracks = loadmat(drive_path)["y_k_j"]
    poses = drive.truth.poses
    ways = {"true": (0, 1), "still": (0, 0), "reversed": (1, 0)}
    medians = {
        way: np.median(
            np.concatenate(
                [
                    reprojection_errors(drive, tracks, k, poses[k + a], poses[k + b])
                    for k in range(0, len(poses) - 1, 5)
                ]
            )
        )
        for way, (a, b) in ways.items()
    }
    assert 3 * medians["true"] < medians["still"] < medians["reversed"]
