"""Bags for tests, written by the library's own writers."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="rosbags is not installed: pip install 'sfmcpp[ros]'")

from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

KINDS = ("bag", "db3", "mcap")
START_NS = 1_403_636_579_763_555_584
_NAN9 = np.zeros(9)


class Messages:
    """Makes messages of one version of ROS."""

    def __init__(self, ros: int) -> None:
        self.ros = ros
        self.store = get_typestore(Stores.ROS1_NOETIC if ros == 1 else Stores.LATEST)
        name = "tf2_msgs/msg/TFMessage"
        if name not in self.store.fielddefs:
            self.store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms\n", name))

    def make(self, type: str, **fields: Any) -> Any:
        return self.store.types[type](**fields)

    def header(self, time_ns: int, frame: str) -> Any:
        stamp = self.make("builtin_interfaces/msg/Time", sec=time_ns // 10**9, nanosec=time_ns % 10**9)
        number = {"seq": 0} if self.ros == 1 else {}
        return self.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame, **number)

    def vector(self, values: Sequence[float]) -> Any:
        return self.make("geometry_msgs/msg/Vector3", **dict(zip("xyz", map(float, values), strict=True)))

    def quaternion(self, wxyz: Sequence[float]) -> Any:
        named = dict(zip("wxyz", map(float, wxyz), strict=True))
        return self.make("geometry_msgs/msg/Quaternion", **named)

    def image(
        self, time_ns: int, pixels: Any, encoding: str = "mono8", frame: str = "cam", pad: int = 0
    ) -> Any:
        rows = np.asarray(pixels, dtype=np.uint8).reshape(len(pixels), -1)
        padded = np.pad(rows, ((0, 0), (0, pad)), constant_values=99)
        height, width = np.shape(pixels)[:2]
        sizes = {"height": height, "width": width, "step": padded.shape[1], "is_bigendian": 0}
        header = self.header(time_ns, frame)
        return self.make(
            "sensor_msgs/msg/Image", header=header, encoding=encoding, data=padded.ravel(), **sizes
        )

    def compressed(self, time_ns: int, data: bytes, frame: str = "cam") -> Any:
        content, header = np.frombuffer(data, np.uint8), self.header(time_ns, frame)
        return self.make("sensor_msgs/msg/CompressedImage", header=header, format="png", data=content)

    def camera_info(self, time_ns: int, matrix: Any, coefficients: Sequence[float] = (), **other: Any) -> Any:
        roi = dict.fromkeys(("x_offset", "y_offset", "height", "width"), 0)
        projection = np.column_stack([matrix, np.zeros(3)])
        arrays = {"k": np.ravel(matrix).astype(float), "d": np.array(coefficients, dtype=float)}
        arrays |= {"r": np.eye(3).ravel(), "p": projection.ravel().astype(float)}
        if self.ros == 1:
            arrays = {name.upper(): value for name, value in arrays.items()}
        fields = {
            "header": self.header(time_ns, "cam"),
            "height": 0,
            "width": 0,
            "distortion_model": "plumb_bob",
            "binning_x": 0,
            "binning_y": 0,
            "roi": self.make("sensor_msgs/msg/RegionOfInterest", do_rectify=False, **roi),
        }
        return self.make("sensor_msgs/msg/CameraInfo", **fields | arrays | other)

    def imu(self, time_ns: int, rate: Sequence[float], frame: str = "imu", covariance: float = 0.0) -> Any:
        spread = np.full(9, covariance)
        return self.make(
            "sensor_msgs/msg/Imu",
            header=self.header(time_ns, frame),
            orientation=self.quaternion((1, 0, 0, 0)),
            orientation_covariance=_NAN9,
            angular_velocity=self.vector(rate),
            angular_velocity_covariance=spread,
            linear_acceleration=self.vector((0, 0, 9.81)),
            linear_acceleration_covariance=_NAN9,
        )

    def fix(self, time_ns: int, place: Sequence[float], sigma_m: float = 0.0, status: int = 0) -> Any:
        state = self.make("sensor_msgs/msg/NavSatStatus", status=status, service=1)
        return self.make(
            "sensor_msgs/msg/NavSatFix",
            header=self.header(time_ns, "gps"),
            status=state,
            **dict(zip(("latitude", "longitude", "altitude"), map(float, place), strict=True)),
            position_covariance=np.diag([sigma_m**2] * 3).ravel(),
            position_covariance_type=2 if sigma_m else 0,
        )

    def twist(self, time_ns: int, velocity: Sequence[float], frame: str = "base_link") -> Any:
        twist = self.make(
            "geometry_msgs/msg/Twist", linear=self.vector(velocity), angular=self.vector((0, 0, 0))
        )
        return self.make("geometry_msgs/msg/TwistStamped", header=self.header(time_ns, frame), twist=twist)

    def odometry(self, time_ns: int, velocity: Sequence[float], frame: str = "base_link") -> Any:
        twist = self.make(
            "geometry_msgs/msg/Twist", linear=self.vector(velocity), angular=self.vector((0, 0, 0))
        )
        place = self.make("geometry_msgs/msg/Point", x=0.0, y=0.0, z=0.0)
        pose = self.make("geometry_msgs/msg/Pose", position=place, orientation=self.quaternion((1, 0, 0, 0)))
        spread = np.zeros(36)
        return self.make(
            "nav_msgs/msg/Odometry",
            header=self.header(time_ns, "odom"),
            child_frame_id=frame,
            pose=self.make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=spread),
            twist=self.make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=spread),
        )

    def transforms(self, *items: tuple[str, str, Sequence[float], Sequence[float]]) -> Any:
        """Of parent, child, quaternion wxyz and place of the child in the parent."""
        made = [
            self.make(
                "geometry_msgs/msg/TransformStamped",
                header=self.header(START_NS, parent),
                child_frame_id=child,
                transform=self.make(
                    "geometry_msgs/msg/Transform",
                    translation=self.vector(place),
                    rotation=self.quaternion(quaternion),
                ),
            )
            for parent, child, quaternion, place in items
        ]
        return self.make("tf2_msgs/msg/TFMessage", transforms=made)


def messages_for(kind: str) -> Messages:
    return Messages(1 if kind == "bag" else 2)


def write_bag(
    path: Path,
    messages: Messages,
    recorded: Iterable[tuple[str, Any]],
    *,
    compression: Any = None,
    **options: Any,
) -> Path:
    """Write a bag of topics and messages, 10 ms apart; the suffix of `path` decides, ``mcap`` in a folder."""
    writer: Any = Writer1(path) if messages.ros == 1 else _writer2(path)
    if compression is not None:
        writer.set_compression(*compression)
    with writer as out:
        topics: dict[str, Any] = {}
        for k, (topic, message) in enumerate(recorded):
            type = message.__msgtype__
            if topic not in topics:
                topics[topic] = out.add_connection(topic, type, typestore=messages.store)
            serialise = messages.store.serialize_ros1 if messages.ros == 1 else messages.store.serialize_cdr
            out.write(topics[topic], START_NS + 10_000_000 * k, serialise(message, type))
    return path


def _writer2(path: Path) -> Any:
    plugin = StoragePlugin.MCAP if path.suffix == ".mcap" else StoragePlugin.SQLITE3
    return Writer2(path, version=9, storage_plugin=plugin)
