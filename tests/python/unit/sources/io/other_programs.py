"""A scene in the files of OpenMVG, AliceVision and VisualSFM, written by their rules and seen by pycolmap."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sfmcpp import Problem
from sfmcpp.sources.io import read

FOCAL, CENTRE, SIZE = 800.0, (321.5, 238.0), (640, 480)
RADIAL, TANGENTIAL = [-0.1, 0.02, -0.003], [1e-3, -2e-3]
NAMES = ["a.jpg", "b c.jpg", "d.jpg", "lost.jpg"]
POINTS = 20
FIRST = 2**31


class Truth:
    """Three cameras that see some points; a fourth photo has no pose. Poses are camera_from_world."""

    def __init__(self) -> None:
        rng = np.random.default_rng(7)
        rotation = pytest.importorskip("scipy.spatial.transform").Rotation
        self.rotations = rotation.from_rotvec(0.2 * rng.normal(size=(3, 3))).as_matrix()
        self.quaternions = np.roll(rotation.from_matrix(self.rotations).as_quat(), 1, axis=1)
        self.centres = rng.normal(size=(3, 3))
        self.points = rng.normal(size=(POINTS, 3)) + np.array([0, 0, 8])

    def in_camera(self, camera: int, point: int) -> np.ndarray:
        x, y, z = self.rotations[camera] @ (self.points[point] - self.centres[camera])
        return np.array([x / z, y / z])

    def pixel(self, camera: int, point: int, radial: list[float], tangential: list[float]) -> list[float]:
        """Where COLMAP's own camera sees a point."""
        pycolmap = pytest.importorskip("pycolmap")
        k1, k2, k3 = radial
        lens = [FOCAL, FOCAL, *CENTRE, k1, k2, *tangential, k3, 0, 0, 0]
        camera_of_colmap = pycolmap.Camera(model="FULL_OPENCV", width=SIZE[0], height=SIZE[1], params=lens)
        seen = np.append(self.in_camera(camera, point), 1.0)
        found: list[float] = camera_of_colmap.img_from_cam(seen[None])[0].tolist()
        return found


TRUTH = Truth()
SEEN = [(camera, point) for point in range(POINTS) for camera in range(3) if (camera + point) % 4]


def openmvg() -> dict[str, Any]:
    """As OpenMVG's exporter packs a scene, its identifiers without order."""

    def packed(number: int, data: dict[str, Any]) -> dict[str, Any]:
        return {"polymorphic_id": 2**30, "ptr_wrapper": {"id": FIRST + number, "data": data}}

    views = [
        {"key": 10 + i, "value": packed(i, {
            "local_path": "", "filename": name, "width": SIZE[0], "height": SIZE[1],
            "id_view": 10 + i, "id_intrinsic": 5, "id_pose": 20 + i})}
        for i, name in enumerate(NAMES)
    ]  # fmt: skip
    base = {"width": SIZE[0], "height": SIZE[1], "focal_length": FOCAL, "principal_point": list(CENTRE)}
    lens = packed(9, {"value0": base, "disto_t2": [*RADIAL, *TANGENTIAL]})
    lens |= {"polymorphic_id": FIRST + 1, "polymorphic_name": "pinhole_brown_t2"}
    poses = [
        {
            "key": 20 + i,
            "value": {"rotation": TRUTH.rotations[i].tolist(), "center": TRUTH.centres[i].tolist()},
        }
        for i in (2, 0, 1)
    ]
    structure = [
        {"key": 70 + point, "value": {"X": TRUTH.points[point].tolist(), "observations": [
            {"key": 10 + camera, "value": {"id_feat": 1, "x": TRUTH.pixel(camera, point, RADIAL, TANGENTIAL)}}
            for camera, other in SEEN if other == point]}}
        for point in range(POINTS)
    ]  # fmt: skip
    return {"sfm_data_version": "0.3", "root_path": "/photos", "views": views,
            "intrinsics": [{"key": 5, "value": lens}], "extrinsics": poses, "structure": structure,
            "control_points": []}  # fmt: skip


def quoted(value: Any) -> Any:
    """All numbers as texts."""
    if isinstance(value, dict):
        return {name: quoted(part) for name, part in value.items()}
    return [quoted(part) for part in value] if isinstance(value, list) else str(value)


def alicevision() -> dict[str, Any]:
    """As AliceVision 2.4 writes it: millimetres, the principal point from the middle, all in quotes."""
    sensor = 7.5
    intrinsic = {
        "intrinsicId": 5, "width": SIZE[0], "height": SIZE[1], "sensorWidth": sensor, "type": "brown",
        "focalLength": FOCAL * sensor / SIZE[0], "pixelRatio": 1, "locked": 0,
        "principalPoint": [CENTRE[0] - SIZE[0] / 2, CENTRE[1] - SIZE[1] / 2],
        "distortionParams": [*RADIAL, *TANGENTIAL],
    }  # fmt: skip
    return quoted({
        "version": [1, 2, 6],
        "featuresFolders": [],
        "views": [
            {"viewId": 10 + i, "poseId": 20 + i, "intrinsicId": 5, "path": name, "width": SIZE[0],
             "height": SIZE[1]}
            for i, name in enumerate(NAMES)
        ],
        "intrinsics": [intrinsic],
        "poses": [
            {"poseId": 20 + i, "pose": {"transform": {"rotation": TRUTH.rotations[i].T.ravel().tolist(),
                                                      "center": TRUTH.centres[i].tolist()}, "locked": 0}}
            for i in (2, 0, 1)
        ],
        "structure": [
            {"landmarkId": point, "descType": "sift", "color": [point, 1, 2],
             "X": TRUTH.points[point].tolist(), "observations": [
                {"observationId": 10 + camera, "featureId": 3,
                 "x": TRUTH.pixel(camera, point, RADIAL, TANGENTIAL)}
                for camera, other in SEEN if other == point]}
            for point in range(POINTS)
        ],
    })  # fmt: skip


MEASURED = 0.05


def distorted_measurement(camera: int, point: int) -> np.ndarray:
    """The m for which ``(1 + r |m|²) m`` is where a camera without distortion sees the point."""
    seen = TRUTH.in_camera(camera, point)
    m = seen.copy()
    for _ in range(100):
        m = seen / (1 + MEASURED * (m @ m))
    return FOCAL * m


def nvm(r: float = MEASURED) -> str:
    def measured(camera: int, point: int) -> np.ndarray:
        return distorted_measurement(camera, point) if r else FOCAL * TRUTH.in_camera(camera, point)

    def row(*numbers: float) -> str:
        return " ".join(repr(float(number)) for number in numbers)

    lines = ["NVM_V3 ", "", "3"]
    for name, quaternion, centre in zip(NAMES, TRUTH.quaternions, TRUTH.centres, strict=False):
        lines.append(f"{name} {row(FOCAL, *quaternion, *centre, r, 0)}")
    lines += ["", str(POINTS)]
    for point in range(POINTS):
        cameras = [camera for camera, other in SEEN if other == point]
        views = [f"{camera} {4 + camera} {row(*measured(camera, point))}" for camera in cameras]
        lines.append(" ".join([row(*TRUTH.points[point]), f"{point} 1 2 {len(cameras)}", *views]))
    return "\n".join([*lines, "", "0", "", "#the last part tells of PLY files", "0", ""])


FILES: dict[str, Callable[[], str]] = {
    "sfm_data.json": lambda: json.dumps(openmvg(), indent=1),
    "cameras.sfm": lambda: json.dumps(alicevision()),
    "model.nvm": nvm,
}


def problem_of(folder: Path, name: str, text: str | None = None) -> Problem:
    (folder / name).write_text(FILES[name]() if text is None else text)
    return read(folder / name)
