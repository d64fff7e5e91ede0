"""Sequences of EuRoC are read as they are: times by name, the mounting, rates and the truth of the body."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sfmcpp.errors import DatasetError
from sfmcpp.model import Trajectory
from sfmcpp.sources.drives import open_drive
from sfmcpp.sources.image_stream import open_images
from sfmcpp.sources.io.trajectories import write_trajectory
from sfmcpp.sources.mounting_files import mounting_of

cv2 = pytest.importorskip("cv2", reason="OpenCV is not installed: pip install 'sfmcpp[vision]'")

START_NS, STEP_NS = 1403636579763555584, 50_000_000
CAMERA = (90.0, 32.0, 24.0)
STAMPS = [START_NS + k * STEP_NS for k in range(4)]
# As calibrated: rounded, so that it is a rotation to some digits only.
T_BS = [
    [0.0148655429818, -0.999880929698, 0.00414029679422, -0.0216401454975],
    [0.999557249008, 0.0149672133247, 0.025715529948, -0.064676986768],
    [-0.0257744366974, 0.00375618835797, 0.999660727178, 0.00981073058949],
    [0.0, 0.0, 0.0, 1.0],
]
SENSOR = f"""sensor_type: camera
T_BS:
  cols: 4
  rows: 4
  data: {[x for row in T_BS for x in row]}
resolution: [64, 48]
camera_model: pinhole
intrinsics: [90.0, 90.0, 32.0, 24.0]
distortion_model: radial-tangential
distortion_coefficients: [0.0, 0.0, 0.0, 0.0]
"""


def write_euroc(folder: Path, *, listed: bool = True) -> Path:
    root = folder / "mav0"
    images = root / "cam0" / "data"
    images.mkdir(parents=True)
    noise = np.random.default_rng(0).integers(0, 256, (48, 64)).astype(np.uint8)
    for stamp in STAMPS:
        assert cv2.imwrite(str(images / f"{stamp}.png"), noise)
    (root / "cam0" / "sensor.yaml").write_text(SENSOR)
    if listed:
        rows = "".join(f"{stamp},{stamp}.png\r\n" for stamp in STAMPS)
        (root / "cam0" / "data.csv").write_text(f"#timestamp [ns],filename\r\n{rows}")
    (root / "imu0").mkdir()
    names = ",".join(f"w_RS_S_{axis} [rad s^-1]" for axis in "xyz")
    rates = "".join(f"{stamp},0.1,0.2,0.3\n" for stamp in STAMPS)
    (root / "imu0" / "data.csv").write_text(f"#timestamp [ns],{names}\n{rates}")
    return root


def times_of(images: Path) -> list[float]:
    return [frame.t_s for frame in open_images(images, CAMERA)[0]]


@pytest.mark.parametrize("listed", [True, False])
def test_times_come_from_the_list_or_the_names_on_the_clock_of_the_imu(tmp_path: Path, listed: bool) -> None:
    root = write_euroc(tmp_path, listed=listed)
    drive = open_drive(root / "cam0" / "data", sensor_file=root / "imu0" / "data.csv", camera=CAMERA)
    assert [frame.t_s for frame in drive.frames] == drive.streams["angular_rate"].t_s.tolist()
    assert drive.frames.assumed_fps is None


def test_names_may_be_seconds(tmp_path: Path) -> None:
    images = write_euroc(tmp_path, listed=False) / "cam0" / "data"
    seconds = [1305031102.175304, 1305031102.211214, 1305031102.243211, 1305031102.275326]
    for stamp, time_s in zip(STAMPS, seconds, strict=True):
        (images / f"{stamp}.png").rename(images / f"{time_s:.6f}.png")
    assert times_of(images) == seconds


def test_the_list_goes_by_names_and_not_by_order(tmp_path: Path) -> None:
    root = write_euroc(tmp_path)
    images = root / "cam0" / "data"
    for number, stamp in enumerate(STAMPS):
        (images / f"{stamp}.png").rename(images / f"{number}.png")
    rows = [f"{stamp},{number}.png\n" for number, stamp in enumerate(STAMPS)]
    (root / "cam0" / "data.csv").write_text("#timestamp [ns],filename\n" + "".join(reversed(rows)))
    np.testing.assert_allclose(np.diff(times_of(images)), 0.05, rtol=1e-5)
    (root / "cam0" / "data.csv").write_text("#timestamp [ns],filename\n" + "".join(rows[:2]))
    with pytest.raises(DatasetError, match=r"data\.csv: tells no time of .*2\.png"):
        times_of(images)
    swapped = [f"{stamp},{number}.png\n" for number, stamp in enumerate(reversed(STAMPS))]
    (root / "cam0" / "data.csv").write_text("#timestamp [ns],filename\n" + "".join(swapped))
    with pytest.raises(DatasetError, match=r"the time of 1\.png is .* s: must be after 0\.png"):
        times_of(images)


def test_another_file_of_that_name_tells_no_times(tmp_path: Path) -> None:
    root = write_euroc(tmp_path)
    images = root / "cam0" / "data"
    for number, stamp in enumerate(STAMPS):
        (images / f"{stamp}.png").rename(images / f"{number}.png")
    (root / "cam0" / "data.csv").write_text("t [s],speed [m/s]\n0,1\n")
    np.testing.assert_allclose(times_of(images), [0.0, 0.1, 0.2, 0.3])


@pytest.mark.parametrize(
    ("unit", "told"),
    [(1, None), (1e-3, "must be in seconds, or all in nanoseconds since 1970"), (1e-9, None)],
)
def test_a_file_of_times_is_in_seconds_or_plainly_in_nanoseconds(
    tmp_path: Path, unit: float, told: str | None
) -> None:
    images = write_euroc(tmp_path) / "cam0" / "data"
    (images / "times.txt").write_text("".join(f"{stamp * unit!r}\n" for stamp in STAMPS))
    if told is None:
        np.testing.assert_allclose(times_of(images), np.array(STAMPS) * 1e-9, rtol=0, atol=1e-6)
    else:
        with pytest.raises(DatasetError, match=told):
            times_of(images)


def test_the_mounting_is_that_of_the_sensor_file(tmp_path: Path) -> None:
    root = write_euroc(tmp_path)
    by_name = mounting_of(root / "cam0" / "sensor.yaml")
    by_itself = open_drive(root / "cam0" / "data").mounting
    for mounting in (by_name, by_itself):
        assert mounting is not None
        np.testing.assert_allclose(mounting.camera_from_body.T, np.array(T_BS)[:3, :3], atol=1e-9)
        np.testing.assert_array_equal(mounting.lever_arm_m, np.array(T_BS)[:3, 3])
    assert open_drive(root / "cam0" / "data", camera=CAMERA).mounting is None


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("K: [1]\n", "holds no mounting: must have T_BS"),
        ("T_BS: [1, 2]\n", "T_BS holds 2 numbers: must be 16"),
        (SENSOR.replace("0.99988", "1.99988"), "T_BS holds no rotation"),
        (SENSOR.replace("0.0, 0.0, 0.0, 1.0]", "0.0, 0.0, 1.0, 1.0]"), "the last row of T_BS is"),
    ],
)
def test_what_is_no_mounting_is_refused(tmp_path: Path, text: str, told: str) -> None:
    file = tmp_path / "sensor.yaml"
    file.write_text(text)
    with pytest.raises(DatasetError, match=told):
        mounting_of(file)


def test_a_word_that_is_no_mounting_is_told_the_words(tmp_path: Path) -> None:
    with pytest.raises(
        DatasetError, match="sideways: is no mounting and no file: must be camera, forward, or"
    ):
        mounting_of("sideways")


@pytest.mark.parametrize("inside", [True, False])
def test_a_sequence_is_read_as_a_whole_with_the_truth_of_its_camera(tmp_path: Path, inside: bool) -> None:
    root = write_euroc(tmp_path)
    body = np.tile(np.eye(3, 4), (4, 1, 1))
    body[:, :, 3] = np.arange(12).reshape(4, 3)
    (root / "state_groundtruth_estimate0").mkdir()
    truth = Trajectory(np.array(STAMPS) * 1e-9, body)
    write_trajectory(truth, root / "state_groundtruth_estimate0" / "data.csv", format="euroc")
    drive = open_drive(root if inside else tmp_path)
    assert len(drive.frames) == 4
    assert set(drive.streams) == {"angular_rate"}
    assert drive.truth is not None
    np.testing.assert_allclose(drive.truth.centres, body[:, :, 3] + np.array(T_BS)[:3, 3], atol=1e-9)
    np.testing.assert_allclose(drive.truth.rotations[0], np.array(T_BS)[:3, :3], atol=1e-9)
