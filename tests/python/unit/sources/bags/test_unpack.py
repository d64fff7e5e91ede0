"""Bags become files that say what the messages said; what cannot be used is refused by topic and reason."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bag_writing import KINDS, START_NS, Messages, messages_for, write_bag
from sfmcpp import DatasetError
from sfmcpp.geometry import so3
from sfmcpp.sources.bags import UnpackedBag, open_bag, unpack_bag
from sfmcpp.sources.bags.unpack import CAMERA_FILE, IMAGE_FOLDER, MOUNTING_FILE, SENSOR_FILE
from sfmcpp.sources.cameras import read_intrinsics
from sfmcpp.sources.io.sensor_csv import read_sensor_csv
from sfmcpp.sources.mounting_files import mounting_of
from sfmcpp.sources.stereo_pair import stereo_pair

cv2 = pytest.importorskip("cv2", reason="OpenCV is not installed: pip install 'sfmcpp[vision]'")

MATRIX = np.array([[100.0, 0.0, 31.5], [0.0, 101.0, 23.5], [0.0, 0.0, 1.0]])
PIXELS = (np.arange(48 * 64) * 7 % 251).astype(np.uint8).reshape(48, 64)
STEP_NS = 100_000_003
# body_from_camera of a camera that looks ahead, as wxyz.
LOOKING_AHEAD = (0.5, -0.5, 0.5, -0.5)


def times(count: int) -> list[int]:
    return [START_NS + k * STEP_NS for k in range(count)]


def unpacked(tmp_path: Path, made: Messages, recorded: Sequence[Any], **options: Any) -> UnpackedBag:
    suffix = "bag" if made.ros == 1 else "mcap"
    return unpack_bag(write_bag(tmp_path / f"drive.{suffix}", made, recorded), tmp_path / "out", **options)


def refused(tmp_path: Path, made: Messages, recorded: Sequence[Any], **options: Any) -> str:
    """The reason; nothing is left behind."""
    with pytest.raises(DatasetError) as caught:
        unpacked(tmp_path, made, recorded, **options)
    assert [file.name for file in tmp_path.iterdir()] == [Path(caught.value.path).name]
    assert "\n" not in str(caught.value)
    return caught.value.reason


def image(tmp_path: Path, number: int = 0) -> Any:
    files = sorted((tmp_path / "out" / IMAGE_FOLDER).iterdir())
    return cv2.imread(str(files[number]), cv2.IMREAD_UNCHANGED)


@pytest.mark.parametrize("kind", KINDS)
def test_topics_are_listed_with_types_and_counts(tmp_path: Path, kind: str) -> None:
    made = messages_for(kind)
    recorded = [("/imu", made.imu(t, (0, 0, 1))) for t in times(3)]
    recorded += [("/cam/image_raw", made.image(t, PIXELS)) for t in times(2)]
    path = write_bag(tmp_path / f"drive.{kind}", made, recorded)
    with open_bag(path) as bag:
        found = [(topic.name, topic.type, topic.count) for topic in bag.topics]
        assert found == [("/cam/image_raw", "sensor_msgs/msg/Image", 2), ("/imu", "sensor_msgs/msg/Imu", 3)]
        assert bag.duration_s == pytest.approx(0.04)
        assert bag.ros == made.ros
    if path.is_dir():
        (file,) = path.glob(f"*.{kind}")
        with open_bag(file) as bag:
            assert [(topic.name, topic.type, topic.count) for topic in bag.topics] == found


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_message_arrives_with_the_time_of_its_header(tmp_path: Path, kind: str) -> None:
    made, rates = messages_for(kind), np.random.default_rng(0).normal(size=(5, 3))
    recorded: list[Any] = []
    for k, t in enumerate(times(5)):
        recorded.append(("/cam/image_raw", made.image(t, PIXELS + k)))
        recorded.append(("/cam/camera_info", made.camera_info(t, MATRIX, (0.1, -0.2, 1e-3, 2e-3, 0.03))))
        recorded.append(("/imu", made.imu(t, rates[k], "base_link")))
        recorded.append(("/odom", made.odometry(t + 7, (k, 0.25, -0.5))))
        recorded.append(("/fix", made.fix(t + 7, (48.0 + k * 1e-5, 11.0, 500.0 + k), 0.5, 0)))
    result = unpack_bag(write_bag(tmp_path / f"drive.{kind}", made, recorded), tmp_path / "out")
    assert result.counts == {"images": 5, "odometer": 5, "imu": 5, "gps": 5}
    assert (result.sensors, result.gps_sigma_m) == (["odometer", "imu", "gps"], pytest.approx(0.5))
    names = sorted(file.name for file in (tmp_path / "out" / IMAGE_FOLDER).iterdir())
    assert names == [f"{t}.png" for t in times(5)]
    np.testing.assert_array_equal(image(tmp_path, 3), PIXELS + 3)
    camera = read_intrinsics(tmp_path / "out" / CAMERA_FILE)
    np.testing.assert_allclose(camera[:5], (100.0, 1.01, 31.5, 23.5, 0.0))
    np.testing.assert_allclose(camera[[5, 6, 10, 11, 7]], (0.1, -0.2, 1e-3, 2e-3, 0.03))
    streams = read_sensor_csv(tmp_path / "out" / SENSOR_FILE)
    np.testing.assert_array_equal(streams["angular_rate"].values, rates)
    for stream in streams.values():
        np.testing.assert_allclose(stream.t_s, np.array(times(5)) * 1e-9, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(streams["velocity"].values, [(k, 0.25, -0.5) for k in range(5)])
    geodetic = [(48.0 + k * 1e-5, 11.0, 500.0 + k) for k in range(5)]
    np.testing.assert_array_equal(streams["geodetic"].values, geodetic)


@pytest.mark.parametrize("encoding", ["rgb8", "bgr8", "8UC3", "rgba8", "bgra8"])
def test_colours_keep_their_order(tmp_path: Path, encoding: str) -> None:
    made, blue_green_red = messages_for("bag"), (10, 100, 200)
    order = {"r": 2, "g": 1, "b": 0, "a": None}
    letters = "bgr" if encoding == "8UC3" else encoding[:-1]
    pixel = [255 if order[letter] is None else blue_green_red[order[letter]] for letter in letters]  # type: ignore[index]
    recorded = [("/image", made.image(START_NS, np.tile(pixel, (4, 6, 1)), encoding, pad=3))]
    unpacked(tmp_path, made, recorded)
    np.testing.assert_array_equal(image(tmp_path), np.tile(blue_green_red, (4, 6, 1)))


@pytest.mark.parametrize("pattern", ["rggb", "bggr", "gbrg", "grbg"])
def test_a_bayer_pattern_becomes_its_colours(tmp_path: Path, pattern: str) -> None:
    made, value = messages_for("mcap"), {"b": 10, "g": 100, "r": 200}
    tile = np.reshape([value[letter] for letter in pattern], (2, 2))
    recorded = [("/image", made.image(START_NS, np.tile(tile, (8, 8)), f"bayer_{pattern}8"))]
    unpacked(tmp_path, made, recorded)
    np.testing.assert_array_equal(image(tmp_path)[4:-4, 4:-4], np.tile((10, 100, 200), (8, 8, 1)))


def test_compressed_images_are_kept_as_they_are(tmp_path: Path) -> None:
    made = messages_for("bag")
    data = [bytes(cv2.imencode(suffix, PIXELS)[1]) for suffix in (".png", ".jpg")]
    recorded = [("/c/image/compressed", made.compressed(t, d)) for t, d in zip(times(2), data, strict=True)]
    recorded += [("/c/camera_info", made.camera_info(START_NS, MATRIX))]
    result = unpacked(tmp_path, made, recorded)
    files = sorted((tmp_path / "out" / IMAGE_FOLDER).iterdir())
    assert [(file.suffix, file.read_bytes()) for file in files] == list(
        zip((".png", ".jpg"), data, strict=True)
    )
    assert result.topics["camera"] == "/c/camera_info"


def test_rectified_images_have_the_camera_of_their_projection(tmp_path: Path) -> None:
    made = messages_for("mcap")
    projection = np.column_stack([np.diag([90.0, 90.0, 1.0]), np.zeros(3)]).ravel()
    projection[[2, 6]] = 30.0, 20.0
    info = made.camera_info(START_NS, MATRIX, (0.3, 0.1, 0, 0, 0), p=projection)
    unpacked(tmp_path, made, [("/c/image_rect", made.image(START_NS, PIXELS)), ("/c/camera_info", info)])
    np.testing.assert_array_equal(read_intrinsics(tmp_path / "out" / CAMERA_FILE), (90, 1, 30, 20, 0))


@pytest.mark.parametrize("images", ["image_raw", "image_rect"])
@pytest.mark.parametrize("kind", ["bag", "mcap"])
def test_both_cameras_of_a_pair_unpacked_one_after_the_other_tell_its_pose(
    tmp_path: Path, kind: str, images: str
) -> None:
    made, recorded = messages_for(kind), []
    turn = so3.rotation_from_angle_axis(np.array([[0.01, -0.02, 0.03]]))[0]
    for side, rotation, baseline_m in (("left", np.eye(3), 0.0), ("right", turn, 0.12)):
        projection = [90.0, 0, 32, -90 * baseline_m, 0, 90, 24, 0, 0, 0, 1, 0]
        numbers = {"r": rotation.ravel(), "p": np.array(projection)}
        numbers = {name.upper() if made.ros == 1 else name: value for name, value in numbers.items()}
        info = made.camera_info(START_NS, MATRIX, (0.1, 0, 0, 0, 0), **numbers)
        recorded += [(f"/{side}/{images}", made.image(START_NS, PIXELS)), (f"/{side}/camera_info", info)]
    bag = write_bag(tmp_path / f"drive.{kind}", made, recorded)
    for side in ("left", "right"):
        unpack_bag(bag, tmp_path / side, topics=[f"/{side}/{images}"])
    file = tmp_path / "left" / CAMERA_FILE
    left, right = (tmp_path / side / "images" for side in ("left", "right"))
    pair = stereo_pair(left, right, read_intrinsics(file), file, None)
    expected = turn if images == "image_raw" else np.eye(3)
    np.testing.assert_allclose(pair.pose, np.column_stack([expected, [0.12, 0, 0]]), rtol=0, atol=1e-12)
    assert pair.right[0] == (100.0 if images == "image_raw" else 90.0)


@pytest.mark.parametrize(
    ("model", "coefficients"), [("rational_polynomial", [0.1, 0, 0, 0, 0, 0, 0, 0]), ("", [])]
)
def test_lenses_that_are_another_in_name_only_are_taken(
    tmp_path: Path, model: str, coefficients: list[float]
) -> None:
    made = messages_for("bag")
    info = made.camera_info(START_NS, MATRIX, coefficients, distortion_model=model)
    unpacked(tmp_path, made, [("/c/image_raw", made.image(START_NS, PIXELS)), ("/c/camera_info", info)])
    camera = read_intrinsics(tmp_path / "out" / CAMERA_FILE)
    np.testing.assert_allclose(camera[:5], (100.0, 1.01, 31.5, 23.5, 0.0))


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"distortion_model": "equidistant", "coefficients": [0.1, 0, 0, 0]}, "'equidistant'"),
        ({"distortion_model": "rational_polynomial", "coefficients": [0, 0, 0, 0, 0, 0.1, 0, 0]}, "beyond"),
        ({"matrix": np.zeros((3, 3))}, "calibration matrix"),
        ({"binning_x": 2}, "binned"),
        ({"distortion_model": "a'\nb: [", "coefficients": [0.1, 0, 0, 0]}, "distortion model"),
    ],
)
def test_other_cameras_are_refused_by_name(tmp_path: Path, change: dict[str, Any], told: str) -> None:
    made, change = messages_for("bag"), dict(change)
    matrix, coefficients = change.pop("matrix", MATRIX), change.pop("coefficients", [])
    info = made.camera_info(START_NS, matrix, coefficients, **change)
    recorded = [("/c/image_raw", made.image(START_NS, PIXELS)), ("/c/camera_info", info)]
    reason = refused(tmp_path, made, recorded)
    assert told in reason
    assert "/c/camera_info" in reason
    assert "--no-camera" in reason
    options = {"topics": ["/c/image_raw"], "camera": False}
    assert "camera" not in unpack_bag(tmp_path / "drive.bag", tmp_path / "out", **options).topics


@pytest.mark.parametrize(
    ("fields", "told"),
    [
        ({"encoding": "mono16"}, "'mono16'"),
        ({"step": 63}, "in rows of 63"),
        ({"height": 47}, "bytes in rows"),
        ({"width": 0}, "for 0×48"),
        ({"width": 70_000, "height": 70_000}, "more than 160 million"),
    ],
)
def test_images_whose_numbers_cannot_be_are_refused(
    tmp_path: Path, fields: dict[str, Any], told: str
) -> None:
    made = messages_for("mcap")
    message = made.image(START_NS + 1, PIXELS)
    for name, value in fields.items():
        setattr(message, name, value)
    recorded = [("/c/image_raw", made.image(START_NS, PIXELS)), ("/c/image_raw", message)]
    reason = refused(tmp_path, made, recorded)
    assert told in reason
    assert reason.startswith("message 1 (/c/image_raw): ")


def test_bytes_that_are_no_image_are_refused(tmp_path: Path) -> None:
    made = messages_for("bag")
    reason = refused(tmp_path, made, [("/c/compressed", made.compressed(START_NS, b"\xff\xd8 not"))])
    assert "no image that can be decoded" in reason


def test_what_has_not_been_measured_is_left_out_and_counted(tmp_path: Path) -> None:
    made = messages_for("bag")
    recorded = [("/fix", made.fix(t, (48, 11, 500 + k))) for k, t in enumerate(times(4))]
    recorded += [("/fix", made.fix(t + 1, (0, 0, 0), status=-1)) for t in times(3)]
    recorded += [("/fix", made.fix(START_NS, (49, 12, 0))), ("/fix", made.fix(START_NS + 2, (np.nan, 0, 0)))]
    result = unpacked(tmp_path, made, recorded)
    assert (result.counts, result.gps_sigma_m) == ({"gps": 4}, None)
    assert result.notes == [
        "4 of 9 messages of /fix have no measurement: left out",
        "1 of 9 messages of /fix repeat a time: left out",
    ]


@pytest.mark.parametrize(
    ("topic", "told"), [("no-rate", "no angular velocity"), ("no-time", "its header has no time")]
)
def test_sensors_that_say_nothing_are_refused(tmp_path: Path, topic: str, told: str) -> None:
    made = messages_for("mcap")
    messages = {
        "no-rate": made.imu(START_NS, (0, 0, 0), covariance=-1.0),
        "no-time": made.imu(0, (0, 0, 1)),
    }
    assert told in refused(tmp_path, made, [(f"/{topic}", messages[topic])])


def test_a_speed_that_cannot_be_is_refused_by_the_reader_of_sensor_files(tmp_path: Path) -> None:
    made = messages_for("bag")
    reason = refused(tmp_path, made, [("/odom", made.odometry(START_NS, (5e3, 0, 0)))])
    assert reason.startswith("/odom: ")
    assert "speed" in reason


def test_static_transforms_give_the_mounting_and_the_axes_of_rates(tmp_path: Path) -> None:
    made = messages_for("bag")
    quarter = (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))  # about z: x of the IMU is y of the body
    static = [
        ("base_link", "mast", (1, 0, 0, 0), (0.5, 0.0, 1.0)),
        ("/mast", "/cam", LOOKING_AHEAD, (0.25, 0.0, 0.0)),
        ("base_link", "imu", quarter, (0.0, 0.0, 0.2)),
        ("mast", "gps", (1, 0, 0, 0), (0.0, 0.0, 1.0)),
    ]
    recorded = [("/tf_static", made.transforms(*static[:2])), ("/tf_static", made.transforms(*static[2:]))]
    recorded += [("/image", made.image(START_NS, PIXELS, frame="/cam"))]
    recorded += [("/imu", made.imu(START_NS, (0.5, 0, 0.25))), ("/speed", made.twist(START_NS, (2, 0, 0)))]
    recorded += [("/fix", made.fix(START_NS, (48, 11, 500)))]
    result = unpacked(tmp_path, made, recorded)
    assert result.mounting == MOUNTING_FILE
    mounting = mounting_of(tmp_path / "out" / MOUNTING_FILE)
    assert mounting is not None
    ahead, left, up = mounting.camera_from_body.T
    np.testing.assert_allclose([ahead, left, up], [(0, 0, 1), (-1, 0, 0), (0, -1, 0)], atol=1e-12)
    np.testing.assert_allclose(mounting.lever_arm_m, (0.75, 0.0, 1.0), atol=1e-12)
    rates = read_sensor_csv(tmp_path / "out" / SENSOR_FILE)["angular_rate"].values
    np.testing.assert_allclose(rates, [(0, 0.5, 0.25)], atol=1e-12)
    (note,) = result.notes
    assert note.startswith("the antenna is 2.06 m from 'base_link'")


def test_without_an_odometer_up_is_that_of_the_gps_not_of_an_imu_upside_down(tmp_path: Path) -> None:
    made = messages_for("bag")
    recorded: list[Any] = [
        ("/tf_static", made.transforms(("gps", "cam", LOOKING_AHEAD, (0, 0, 0)))),
        ("/tf_static", made.transforms(("gps", "imu", (0, 1, 0, 0), (0, 0, 0)))),
        ("/image", made.image(START_NS, PIXELS)),
        ("/imu", made.imu(START_NS, (0.5, 0.25, 1))),
        ("/fix", made.fix(START_NS, (48, 11, 500))),
    ]
    unpacked(tmp_path, made, recorded)
    mounting = mounting_of(tmp_path / "out" / MOUNTING_FILE)
    assert mounting is not None
    np.testing.assert_allclose(mounting.camera_from_body[:, 2], (0, -1, 0), atol=1e-12)
    rates = read_sensor_csv(tmp_path / "out" / SENSOR_FILE)["angular_rate"].values
    np.testing.assert_allclose(rates, [(0.5, -0.25, -1)], atol=1e-12)


@pytest.mark.parametrize("frame", ["", "cam"])
def test_a_frame_that_is_the_cameras_is_told_from_one_without_a_name(tmp_path: Path, frame: str) -> None:
    made = messages_for("mcap")
    recorded = [("/image", made.image(START_NS, PIXELS, frame=frame))]
    recorded += [("/imu", made.imu(START_NS, (0, 0, 1), frame))]
    assert unpacked(tmp_path, made, recorded).mounting == ("camera" if frame else None)


def test_without_transforms_the_mounting_is_not_made_up(tmp_path: Path) -> None:
    made = messages_for("mcap")
    recorded = [("/image", made.image(START_NS, PIXELS)), ("/imu", made.imu(START_NS, (0, 0, 1)))]
    result = unpacked(tmp_path, made, recorded)
    assert (result.mounting, result.notes) == (
        None,
        ["no /tf_static joins 'cam', the camera's frame, to 'imu'"],
    )


def test_transforms_that_go_in_a_circle_end(tmp_path: Path) -> None:
    made = messages_for("bag")
    loop = [("a", "b", (1, 0, 0, 0), (0, 0, 0)), ("b", "a", (1, 0, 0, 0), (0, 0, 0))]
    recorded = [("/tf_static", made.transforms(*loop)), ("/image", made.image(START_NS, PIXELS, frame="a"))]
    assert unpacked(tmp_path, made, [*recorded, ("/imu", made.imu(START_NS, (0, 0, 1)))]).mounting is None


def test_one_of_several_topics_must_be_named(tmp_path: Path) -> None:
    made = messages_for("bag")
    recorded = [(f"/imu{k}", made.imu(t, (0, 0, k))) for t in times(2) for k in (0, 1)]
    assert "several topics for imu: /imu0, /imu1" in refused(tmp_path, made, recorded)
    path = tmp_path / "drive.bag"
    assert unpack_bag(path, tmp_path / "out", topics=["/imu1"]).topics == {"imu": "/imu1"}
    with pytest.raises(DatasetError, match="holds no topic '/imu2': it holds /imu0, /imu1"):
        unpack_bag(path, tmp_path / "other", topics=["/imu2"])


def test_a_folder_of_ros_2_may_be_called_as_files_of_ros_1_are(tmp_path: Path) -> None:
    made = Messages(2)
    bag = write_bag(tmp_path / "drive.db3", made, [("/imu", made.imu(START_NS, (0, 0, 1)))])
    found = unpack_bag(bag.rename(tmp_path / "drive.bag"), tmp_path / "out")
    assert found.counts == {"imu": 1}


def test_a_folder_that_holds_something_is_left_alone(tmp_path: Path) -> None:
    made, out = messages_for("bag"), tmp_path / "out"
    path = write_bag(tmp_path / "drive.bag", made, [("/imu", made.imu(START_NS, (0, 0, 1)))])
    out.mkdir()
    (out / "mine").write_text("mine")
    with pytest.raises(DatasetError, match="is not empty"):
        unpack_bag(path, out)
    assert [file.name for file in out.iterdir()] == ["mine"]
    (out / "mine").unlink()
    unpack_bag(path, out)
    assert [file.name for file in out.iterdir()] == [SENSOR_FILE]


def test_ctrl_c_leaves_nothing_behind(tmp_path: Path) -> None:
    made = messages_for("bag")
    path = write_bag(tmp_path / "drive.bag", made, [("/image", made.image(START_NS, PIXELS))])
    seen: list[int] = []

    def stop(done: int, total: int) -> None:
        seen.append(total)
        if done == total:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        unpack_bag(path, tmp_path / "out", progress=stop)
    assert seen == [1, 1]
    assert [file.name for file in tmp_path.iterdir()] == ["drive.bag"]
