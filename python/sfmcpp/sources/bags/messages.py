"""Messages of ROS as what a SLAM run reads: images, a camera, and rows of sensor files.

Rates, velocities and positions are in the units of ROS (REP 103), which are ours. Whose axes they have is
told by `frame_of`.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfmcpp.errors import DatasetError
from sfmcpp.sources.vision.images import encode_png, open_image, require_few_pixels

IMAGES, CAMERA, TRANSFORMS = "images", "camera", "transforms"
# What becomes of messages of a type; the names of sensors are those of `sfmcpp slam --sensor`.
ROLES = {
    "sensor_msgs/msg/Image": IMAGES,
    "sensor_msgs/msg/CompressedImage": IMAGES,
    "sensor_msgs/msg/CameraInfo": CAMERA,
    "sensor_msgs/msg/Imu": "imu",
    "sensor_msgs/msg/NavSatFix": "gps",
    "nav_msgs/msg/Odometry": "odometer",
    "geometry_msgs/msg/TwistStamped": "odometer",
    "tf2_msgs/msg/TFMessage": TRANSFORMS,
}
COLUMNS = {
    "odometer": ("vx [m/s]", "vy [m/s]", "vz [m/s]"),
    "imu": ("wx [rad/s]", "wy [rad/s]", "wz [rad/s]"),
    "gps": ("lat [deg]", "lon [deg]", "height [m]"),
}

# Bytes of a pixel, and OpenCV's conversion to what it writes. Its letters of a Bayer pattern are those of the
# second row, from the second column on.
_ENCODINGS: dict[str, tuple[int, str | None]] = {
    "mono8": (1, None),
    "8UC1": (1, None),
    "bgr8": (3, None),
    "8UC3": (3, None),
    "rgb8": (3, "COLOR_RGB2BGR"),
    "bgra8": (4, "COLOR_BGRA2BGR"),
    "rgba8": (4, "COLOR_RGBA2BGR"),
    "bayer_rggb8": (1, "COLOR_BayerBG2BGR"),
    "bayer_bggr8": (1, "COLOR_BayerRG2BGR"),
    "bayer_gbrg8": (1, "COLOR_BayerGR2BGR"),
    "bayer_grbg8": (1, "COLOR_BayerGB2BGR"),
}
_SUFFIXES = {"PNG": ".png", "JPEG": ".jpg"}
_RECTIFIED = re.compile(r"(?:^|/)image_rect")
# `status` of a fix is this or more: STATUS_FIX.
_LEAST_FIX = 0
_UNKNOWN_COVARIANCE = 0

Row = tuple[float, ...]


class Unusable(Exception):
    """A message that cannot be used, and why."""


def stamp_ns(message: Any) -> int:
    """Time of a message, as its header has it [ns]."""
    stamp = message.header.stamp
    total = int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)
    if total <= 0:
        raise Unusable("its header has no time")
    return total


def frame_of(message: Any) -> str:
    """Name of the frame whose axes the measurement has, without the slash that ROS 1 allows before it."""
    name: str = getattr(message, "child_frame_id", "") or message.header.frame_id
    return name.lstrip("/")


def image_file(message: Any, path: Path) -> tuple[str, bytes]:
    """Suffix and content of a file of an image.

    Raises
    ------
    Unusable
        If its encoding is not supported, or its numbers contradict each other.
    DatasetError
        If it has more pixels than images may have.
    """
    if not hasattr(message, "encoding"):
        return _compressed_image(message, path)
    if message.encoding not in _ENCODINGS:
        rule = f"must be one of {', '.join(_ENCODINGS)}"
        raise Unusable(f"encoding {message.encoding!r}: {rule}")
    channels, conversion = _ENCODINGS[message.encoding]
    require_few_pixels(path, message.width, message.height)
    return ".png", encode_png(_pixels(message, channels), conversion)


def _pixels(message: Any, channels: int) -> NDArray[np.uint8]:
    width, height, step = message.width, message.height, message.step
    data = np.asarray(message.data, dtype=np.uint8)
    if not (width > 0 and height > 0 and step >= width * channels and len(data) == step * height):
        size = f"{width}×{height} pixels of {channels} bytes"
        raise Unusable(f"has {len(data)} bytes in rows of {step} for {size}")
    rows = data.reshape(height, step)[:, : width * channels]
    shape = (height, width, channels) if channels > 1 else (height, width)
    return np.ascontiguousarray(rows).reshape(shape)


def _compressed_image(message: Any, path: Path) -> tuple[str, bytes]:
    data = bytes(message.data)
    try:
        with open_image(path, data) as image:
            format = image.format
    except DatasetError:
        raise
    except Exception as error:  # Pillow's parsers raise whatever they stumble over
        raise Unusable(f"is no image that can be decoded ({len(data)} bytes)") from error
    if format not in _SUFFIXES:
        raise Unusable(f"is an image of the format {format}: must be one of {', '.join(_SUFFIXES)}")
    return _SUFFIXES[format], data


def camera_yaml(message: Any, images: str) -> str:
    """A calibration in the form of ROS's files; of rectified images that of their projection.

    Rectification and projection tell how the camera of a stereo pair sits beside the other one.

    Raises
    ------
    Unusable
        If it is for images that were binned or cut.
    """
    binned = max(message.binning_x, message.binning_y) > 1
    if binned or message.roi.x_offset or message.roi.y_offset:
        raise Unusable("is for images that are binned or cut: not supported")
    rectified = _RECTIFIED.search(images) is not None
    known = {name.lower(): value for name, value in vars(message).items()}  # K and D of ROS 1, k and d of 2
    matrix = np.reshape(known["p"], (3, 4))[:, :3] if rectified else np.reshape(known["k"], (3, 3))
    coefficients = [] if rectified else list(map(float, known["d"]))
    lens = "plumb_bob" if rectified else message.distortion_model
    turn = np.eye(3) if rectified else np.reshape(known["r"], (3, 3))
    size = f"image_width: {message.width}\nimage_height: {message.height}\n"
    return (
        f"{size if message.width and message.height else ''}"
        f"{_matrix_yaml('camera_matrix', matrix)}"
        f"distortion_model: '{_word(lens)}'\n"
        f"distortion_coefficients: {{rows: 1, cols: {len(coefficients)}, data: {coefficients}}}\n"
        f"{_matrix_yaml('rectification_matrix', turn)}"
        f"{_matrix_yaml('projection_matrix', np.reshape(known['p'], (3, 4)))}"
    )


def _matrix_yaml(name: str, matrix: NDArray[np.float64]) -> str:
    numbers = ", ".join(repr(float(number)) for number in matrix.ravel())
    return f"{name}: {{rows: {len(matrix)}, cols: {matrix.shape[1]}, data: [{numbers}]}}\n"


def _word(text: str) -> str:
    """A text as it can stand in a file between quotes."""
    return re.sub(r"[^\w.\- ]", "?", text)[:40]


def sensor_row(message: Any, role: str) -> Row | None:
    """Values of the columns of a sensor; None where it has not measured.

    Raises
    ------
    Unusable
        If an IMU has no gyroscope.
    """
    row = _ROWS[role](message)
    return row if row is not None and np.isfinite(row).all() else None


def _velocity(message: Any) -> Row:
    twist = getattr(message.twist, "twist", message.twist)  # of Odometry it has a covariance beside
    return twist.linear.x, twist.linear.y, twist.linear.z


def _rate(message: Any) -> Row:
    if message.angular_velocity_covariance[0] == -1:
        raise Unusable("has no angular velocity, by its covariance of -1")
    rate = message.angular_velocity
    return rate.x, rate.y, rate.z


def _fix(message: Any) -> Row | None:
    if message.status.status < _LEAST_FIX:
        return None
    return message.latitude, message.longitude, message.altitude


_ROWS: dict[str, Callable[[Any], Row | None]] = {"odometer": _velocity, "imu": _rate, "gps": _fix}


def sigma_of_fix(message: Any) -> float | None:
    """Standard deviation along an axis, of all three the root mean square [m]; None where it is unknown."""
    variance = float(np.sum(message.position_covariance[[0, 4, 8]])) / 3
    if message.position_covariance_type == _UNKNOWN_COVARIANCE or not 0 < variance < np.inf:
        return None
    return float(np.sqrt(variance))
