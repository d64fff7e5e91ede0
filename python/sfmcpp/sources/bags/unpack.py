"""Files of a bag that a SLAM run reads: images named by their times, a camera, a sensor file, a mounting."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from sfmcpp.errors import DatasetError
from sfmcpp.model.arguments import checked
from sfmcpp.sources.bags.container import Bag, Topic, open_bag
from sfmcpp.sources.bags.messages import (
    CAMERA,
    COLUMNS,
    IMAGES,
    ROLES,
    TRANSFORMS,
    Row,
    Unusable,
    camera_yaml,
    frame_of,
    image_file,
    sensor_row,
    sigma_of_fix,
    stamp_ns,
)
from sfmcpp.sources.bags.transforms import StaticFrames
from sfmcpp.sources.io.calibration import read_calibration
from sfmcpp.sources.io.files import (
    failures_named,
    is_present,
    require_folder,
    require_parent_folder,
    scratch_folder_beside,
)
from sfmcpp.sources.io.sensor_csv import read_sensor_csv
from sfmcpp.sources.vision.images import load_cv2

IMAGE_FOLDER, CAMERA_FILE, SENSOR_FILE, MOUNTING_FILE = "images", "camera.yaml", "sensors.csv", "mounting.txt"
_STATIC_TRANSFORMS = "/tf_static"
# An antenna as far from the body's origin as a GPS without corrections cannot tell [m].
_NOTEWORTHY_LEVER_M = 0.1
# Whose frame is that of the body, if it is joined to the camera's: an IMU may lie in any way.
_BODY = ("odometer", "gps", "imu")
# Sensors whose times are closer share a row: seconds since 1970 have no more digits than for 240 ns.
_ROUNDED_NS = 1000
_CHECKED_EVERY = 64

Progress = Callable[[int, int], object]


@dataclass(frozen=True)
class UnpackedBag:
    """What was made of a bag.

    Attributes
    ----------
    folder : Path
        Where the files are.
    topics : mapping of str to str
        Topic by what was made of it: ``"images"``, ``"camera"``, and the names of sensors.
    counts : mapping of str to int
        Number of images and of measurements, by the same names.
    mounting : str or None
        What `slam` is to be told: a file's name, ``"camera"``, or None where the bag does not tell.
    gps_sigma_m : float or None
        Median of the standard deviations that the fixes have along an axis [m], where they have any.
    notes : list of str
        What was left out or had to be assumed, a sentence each.
    """

    folder: Path
    topics: Mapping[str, str]
    counts: Mapping[str, int]
    mounting: str | None
    gps_sigma_m: float | None
    notes: list[str]

    @property
    def sensors(self) -> list[str]:
        """Names of the sensors."""
        return [name for name in COLUMNS if name in self.topics]


@checked()
def unpack_bag(
    path: str | PathLike[str],
    folder: str | PathLike[str],
    *,
    topics: Sequence[str] = (),
    camera: bool = True,
    progress: Progress | None = None,
) -> UnpackedBag:
    """Make files of a bag that :func:`sfmcpp.slam.run` reads; all or none appear.

    Parameters
    ----------
    path : path-like
        The bag; see :func:`sfmcpp.sources.bags.open_bag`.
    folder : path-like
        Where to: it must be missing or empty. It gets ``images`` with files named by their times in
        nanoseconds, ``camera.yaml``, ``sensors.csv``, and ``mounting.txt`` where ``/tf_static`` joins the
        camera to the body: the frame of the odometer, else of the GPS, else of the IMU.
    topics : sequence of str, optional
        Topics to take, one for images and one for each sensor. Default: those that there are.
    camera : bool
        Whether to take the calibration that belongs to the images.
    progress : callable, optional
        Called now and then as ``progress(done, total)`` with numbers of messages.

    Returns
    -------
    UnpackedBag

    Raises
    ------
    DatasetError
        If the bag cannot be read, a topic is missing, of a type that is not read, or one of several for the
        same; if an image, a calibration or a sensor cannot be used; or if the files cannot be written.
    """
    source, target = Path(path), Path(folder)
    _require_new_folder(target)
    with open_bag(source) as bag, _new_folder(target) as scratch:
        chosen = _chosen_topics(bag, topics, camera)
        if IMAGES in chosen:
            _require_opencv(source)
        unpacking = _Unpacking(bag, chosen, scratch)
        unpacking.run(progress or (lambda done, total: None))
        return unpacking.finished(target)


def _require_new_folder(folder: Path) -> None:
    with failures_named(folder):
        require_folder(folder)
        if is_present(folder) and any(folder.iterdir()):
            raise DatasetError(folder, "is not empty: name a new folder")
        require_parent_folder(folder)


@contextmanager
def _new_folder(target: Path) -> Iterator[Path]:
    """A folder to write to, which takes the name `target` if the block ends well."""
    with scratch_folder_beside(target) as name:
        scratch = Path(name) / "new"
        scratch.mkdir()
        with failures_named(target):
            yield scratch
            scratch.replace(target)


def _require_opencv(path: Path) -> None:
    try:
        load_cv2()
    except ModuleNotFoundError as error:
        raise DatasetError(path, str(error)) from None


def _chosen_topics(bag: Bag, asked: Sequence[str], camera: bool) -> dict[str, Topic]:
    """Topic for each role."""
    named = {topic.name: topic for topic in bag.topics}
    for name in asked:
        if name not in named:
            raise DatasetError(bag.path, f"holds no topic {name!r}: it holds {', '.join(named) or 'none'}")
        if ROLES.get(named[name].type, TRANSFORMS) == TRANSFORMS:
            raise DatasetError(bag.path, f"topic {name} is of type {named[name].type}, which is not read")
    candidates = [named[name] for name in asked] if asked else [t for t in bag.topics if t.count]
    found: dict[str, Topic] = {}
    for role in (IMAGES, *COLUMNS):
        found |= _only_topic(bag, role, [t for t in candidates if ROLES.get(t.type) == role])
    if not found:
        raise DatasetError(bag.path, f"holds no topic that is read: must be of {', '.join(ROLES)}")
    if camera and IMAGES in found:
        given = [t for t in candidates if ROLES.get(t.type) == CAMERA] if asked else []
        beside = named.get(_camera_topic(found[IMAGES].name))
        found |= _only_topic(bag, CAMERA, given or ([beside] if beside is not None else []))
    static = named.get(_STATIC_TRANSFORMS)
    if static is not None and ROLES.get(static.type) == TRANSFORMS:
        found[TRANSFORMS] = static
    return found


def _only_topic(bag: Bag, role: str, topics: Sequence[Topic]) -> dict[str, Topic]:
    if len(topics) > 1:
        names = ", ".join(topic.name for topic in topics)
        raise DatasetError(bag.path, f"several topics for {role}: {names}: say which, as --topic NAME")
    return {role: topics[0]} if topics else {}


def _camera_topic(images: str) -> str:
    """Where ROS has the calibration of images: beside them."""
    return images.removesuffix("/compressed").rpartition("/")[0] + "/camera_info"


@dataclass
class _Stream:
    """Measurements of a sensor by their times [ns]."""

    rows: dict[int, Row] = field(default_factory=dict)
    sigmas: list[float] = field(default_factory=list)


class _Unpacking:
    """A bag on its way into a folder."""

    def __init__(self, bag: Bag, topics: Mapping[str, Topic], folder: Path) -> None:
        self._bag, self._topics, self._folder = bag, topics, folder
        self._roles = {topic.name: role for role, topic in topics.items()}
        self._streams = {role: _Stream() for role in COLUMNS if role in topics}
        self._frames, self._static = dict[str, str](), StaticFrames()
        self._images, self._camera = set[int](), ""
        self._left_out: dict[tuple[str, str], int] = {}
        self._notes: list[str] = []

    def run(self, progress: Progress) -> None:
        """Go through the messages; images are written as they come."""
        if IMAGES in self._topics:
            (self._folder / IMAGE_FOLDER).mkdir()
        total = sum(topic.count for topic in self._topics.values())
        for number, (name, message) in enumerate(self._bag.messages(self._roles)):
            if number % _CHECKED_EVERY == 0:
                progress(number, total)
            role = self._roles[name]
            try:
                self._take(role, message)
            except Unusable as error:
                hint = "; --no-camera leaves it out" if role == CAMERA else ""
                raise DatasetError(self._bag.path, f"message {number} ({name}): {error}{hint}") from error
            except DatasetError as error:
                raise DatasetError(self._bag.path, f"message {number} ({name}): {error.reason}") from error
        progress(total, total)

    def _take(self, role: str, message: Any) -> None:
        if role == TRANSFORMS:
            self._static.add(message)
        elif role == CAMERA:
            self._take_camera(message)
        else:
            time_ns = stamp_ns(message)
            self._frames.setdefault(role, frame_of(message))
            if role == IMAGES:
                self._take_image(time_ns, message)
            else:
                self._take_row(role, time_ns, message)

    def _take_camera(self, message: Any) -> None:
        text = camera_yaml(message, self._topics[IMAGES].name)
        if self._camera not in ("", text):
            raise Unusable("differs from those before it: one camera is wanted")
        self._camera = text

    def _take_image(self, time_ns: int, message: Any) -> None:
        if time_ns in self._images:
            self._leave_out(IMAGES, "repeat a time")
            return
        suffix, data = image_file(message, self._bag.path)
        self._images.add(time_ns)
        (self._folder / IMAGE_FOLDER / f"{time_ns:019d}{suffix}").write_bytes(data)

    def _take_row(self, role: str, time_ns: int, message: Any) -> None:
        stream, row = self._streams[role], sensor_row(message, role)
        time_ns = (time_ns + _ROUNDED_NS // 2) // _ROUNDED_NS * _ROUNDED_NS
        if row is None:
            self._leave_out(role, "have no measurement")
        elif time_ns in stream.rows:
            self._leave_out(role, "repeat a time")
        else:
            stream.rows[time_ns] = row
            if role == "gps" and (sigma_m := sigma_of_fix(message)) is not None:
                stream.sigmas.append(sigma_m)

    def _leave_out(self, role: str, why: str) -> None:
        self._left_out[role, why] = self._left_out.get((role, why), 0) + 1

    def finished(self, target: Path) -> UnpackedBag:
        """Write the rest, check that it can be read, and tell what was made for `target`."""
        self._require_contents()
        mounting = self._mounting()
        if self._camera:
            self._write_camera()
        if self._streams:
            self._write_sensors()
        for (role, why), count in self._left_out.items():
            topic = self._topics[role]
            self._notes.append(f"{count:,} of {topic.count:,} messages of {topic.name} {why}: left out")
        counts = {role: len(stream.rows) for role, stream in self._streams.items()}
        if IMAGES in self._topics:
            counts[IMAGES] = len(self._images)
        names = {role: topic.name for role, topic in self._topics.items() if role != TRANSFORMS}
        sigmas = self._streams["gps"].sigmas if "gps" in self._streams else []
        sigma_m = float(np.median(sigmas)) if sigmas else None
        if not self._camera:
            names.pop(CAMERA, None)
        return UnpackedBag(target, names, counts, mounting, sigma_m, self._notes)

    def _require_contents(self) -> None:
        found = {IMAGES: self._images} | {role: stream.rows for role, stream in self._streams.items()}
        for role, contents in found.items():
            if role in self._topics and not contents:
                topic = self._topics[role]
                reason = f"none of the {topic.count:,} messages of {topic.name} can be used for {role}"
                raise DatasetError(self._bag.path, reason)

    def _write_camera(self) -> None:
        file = self._folder / CAMERA_FILE
        file.write_text(self._camera)
        with self._named_as_bag(self._topics[CAMERA].name, "; --no-camera leaves it out"):
            read_calibration(file)

    def _write_sensors(self) -> None:
        file, roles = self._folder / SENSOR_FILE, list(self._streams)
        times = sorted(set().union(*(stream.rows for stream in self._streams.values())))
        empty = {role: ("",) * len(COLUMNS[role]) for role in roles}
        with file.open("w") as out:
            out.write(",".join(["t [ns]", *(name for role in roles for name in COLUMNS[role])]) + "\n")
            for time_ns in times:
                rows = (self._streams[role].rows.get(time_ns) for role in roles)
                cells = [
                    cell
                    for role, row in zip(roles, rows, strict=True)
                    for cell in (empty[role] if row is None else map(repr, map(float, row)))
                ]
                out.write(f"{time_ns},{','.join(cells)}\n")
        with self._named_as_bag(", ".join(self._topics[role].name for role in roles)):
            read_sensor_csv(file)

    @contextmanager
    def _named_as_bag(self, topics: str, hint: str = "") -> Iterator[None]:
        """Name the bag and its topics where a file that was made of them is refused."""
        try:
            yield
        except DatasetError as error:
            raise DatasetError(self._bag.path, f"{topics}: {error.reason}{hint}") from error

    def _mounting(self) -> str | None:
        """Pose of the camera on the body, as `slam` takes it; turns the rates to the axes of the body."""
        if not self._streams:
            return None
        camera = self._frames.get(IMAGES, "")
        bodies = [self._frames[role] for role in _BODY if role in self._streams]
        joined = (name for name in bodies if self._static.pose(name, camera) is not None)
        body = next(joined, bodies[0])
        for role in [name for name in self._streams if self._frames[name] != body]:
            self._join(role, body)
        if not camera:
            return None
        if camera == body:
            return "camera"
        pose = self._static.pose(body, camera)
        if pose is None:
            self._notes.append(f"no {_STATIC_TRANSFORMS} joins {camera!r}, the camera's frame, to {body!r}")
            return None
        np.savetxt(self._folder / MOUNTING_FILE, pose, fmt="%.17g")
        return MOUNTING_FILE

    def _join(self, role: str, body: str) -> None:
        pose = self._static.pose(body, self._frames[role])
        if pose is None:
            joined = f"no {_STATIC_TRANSFORMS} joins {self._frames[role]!r}, the frame of {role}, to {body!r}"
            self._notes.append(f"{joined}: they are taken for one")
        elif role == "imu":
            rows = self._streams[role].rows
            turned = np.array(list(rows.values())) @ pose[:, :3].T
            self._streams[role].rows = dict(zip(rows, map(tuple, turned.tolist()), strict=True))
        elif (lever_m := float(np.linalg.norm(pose[:, 3]))) > _NOTEWORTHY_LEVER_M:
            self._notes.append(
                f"the antenna is {lever_m:.2f} m from {body!r}, for which positions are taken all the same"
            )
