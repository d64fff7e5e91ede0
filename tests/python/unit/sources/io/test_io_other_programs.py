"""OpenMVG, AliceVision and VisualSFM: files of a scene, written here by their rules and seen by pycolmap."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sfmcpp
from io_helpers import assert_same_problem, residuals
from sfmcpp import DatasetError, Problem
from sfmcpp.sources.io import read, write

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


@pytest.mark.parametrize("name", FILES)
def test_a_scene_has_its_poses_points_and_no_residuals(tmp_path: Path, name: str) -> None:
    problem = problem_of(tmp_path, name)
    assert (problem.num_cameras, problem.num_points, problem.num_observations) == (3, POINTS, len(SEEN))
    assert problem.metadata.image_names == NAMES[:3]
    np.testing.assert_allclose(problem.centres, TRUTH.centres, rtol=0, atol=1e-14)
    np.testing.assert_allclose(problem.rotations, np.swapaxes(TRUTH.rotations, 1, 2), rtol=0, atol=1e-14)
    np.testing.assert_array_equal(problem.points, TRUTH.points)
    np.testing.assert_allclose(residuals(problem), 0, atol=1e-9)
    np.testing.assert_allclose(sfmcpp.residuals(problem), 0, atol=1e-9)


@pytest.mark.parametrize("name", ["sfm_data.json", "cameras.sfm"])
def test_photos_without_a_pose_are_named_and_lenses_and_sizes_are_kept(tmp_path: Path, name: str) -> None:
    problem = problem_of(tmp_path, name)
    assert problem.metadata.extra["unregistered_images"] == ["lost.jpg"]
    np.testing.assert_array_equal(problem.metadata.image_sizes, [SIZE] * 3)
    lens = dict(zip(problem.intrinsic_names, problem.intrinsics[0], strict=True))
    assert [lens[k] for k in ("cx", "cy", "k1", "k2", "k3", "p1", "p2")] == [*CENTRE, *RADIAL, *TANGENTIAL]
    free = [name for name, fixed in zip(lens, problem.fixed_intrinsics[0], strict=True) if not fixed]
    assert free == ["f", "k1", "k2", "k3", "p1", "p2"]
    assert len(problem.intrinsics) == 1


@pytest.mark.parametrize("name", FILES)
def test_a_scene_is_adjusted_and_handed_on_to_colmap(tmp_path: Path, name: str) -> None:
    problem = problem_of(tmp_path, name)
    problem.points += 0.01
    problem.set_free_intrinsics()
    assert sfmcpp.solve(problem).final_rms_px < 1e-6
    columns = [problem.intrinsic_names.index(k) for k in ("k3", "p1", "p2") if k in problem.intrinsic_names]
    problem.intrinsics[:, columns] = 0  # which no supported model of COLMAP holds together
    write(problem, tmp_path / "model")
    assert read(tmp_path / "model").metadata.image_names == NAMES[:3]


@pytest.mark.parametrize("name", FILES)
def test_what_is_written_for_visualsfm_is_the_scene_without_distortion(tmp_path: Path, name: str) -> None:
    problem = problem_of(tmp_path, name)
    write(problem, tmp_path / "written.nvm")
    again = read(tmp_path / "written.nvm")
    np.testing.assert_allclose(again.cameras, problem.cameras, rtol=0, atol=1e-14)
    np.testing.assert_array_equal(again.points, problem.points)
    by_track = np.lexsort((problem.camera_index, problem.point_index))
    np.testing.assert_array_equal(again.camera_index, problem.camera_index[by_track])
    np.testing.assert_array_equal(again.point_index, problem.point_index[by_track])
    np.testing.assert_allclose(sfmcpp.residuals(again), 0, atol=1e-8)
    assert again.metadata.image_names == problem.metadata.image_names
    if problem.metadata.point_colors is not None:
        np.testing.assert_array_equal(again.metadata.point_colors, problem.metadata.point_colors)


@pytest.mark.parametrize("name", ["sfm_data.json", "cameras.sfm"])
@pytest.mark.parametrize("target", ["again_sfm_data.json", "again.sfm"])
def test_a_scene_is_handed_on_with_lenses_names_and_sizes(tmp_path: Path, name: str, target: str) -> None:
    problem = problem_of(tmp_path, name)
    write(problem, tmp_path / target)
    again = read(tmp_path / target)
    assert_same_problem(again, problem, intrinsics_rtol=1e-15)
    assert again.metadata.image_names == problem.metadata.image_names
    np.testing.assert_array_equal(again.metadata.image_sizes, [SIZE] * 3)
    if name == "cameras.sfm" and target == "again.sfm":
        np.testing.assert_array_equal(again.metadata.point_colors, problem.metadata.point_colors)


@pytest.mark.parametrize("name", ["sfm_data.json", "cameras.sfm"])
def test_what_is_written_for_g2o_is_the_scene_without_distortion(tmp_path: Path, name: str) -> None:
    problem = problem_of(tmp_path, name)
    write(problem, tmp_path / "written.g2o")
    again = read(tmp_path / "written.g2o")
    np.testing.assert_allclose(again.cameras, problem.cameras, rtol=0, atol=1e-14)
    np.testing.assert_array_equal(again.points, problem.points)
    np.testing.assert_allclose(sfmcpp.residuals(again), 0, atol=1e-8)
    lens = dict(zip(again.intrinsic_names, again.intrinsics[0], strict=True))
    assert (lens["f"], lens["cx"], lens["cy"], lens["k1"]) == (FOCAL, *CENTRE, 0)


def test_what_is_written_for_openmvg_is_packed_as_its_reader_unpacks(tmp_path: Path) -> None:
    problem = sfmcpp.circle_scene(3, 5, camera_model="perspective", seed=0)
    problem.intrinsics[2, problem.intrinsic_names.index("k1")] = 0.1
    write(problem, tmp_path / "sfm_data.json")
    content = json.loads((tmp_path / "sfm_data.json").read_text())
    assert list(content) == list(openmvg())
    packed = [entry["value"] for part in ("views", "intrinsics") for entry in content[part]]
    pointers = [value["ptr_wrapper"]["id"] for value in packed]
    assert pointers == list(range(FIRST + 1, FIRST + 7))
    assert [value["polymorphic_id"] for value in packed] == [*[2**30] * 3, FIRST + 1, 1, FIRST + 2]
    models = [value.get("polymorphic_name") for value in packed[3:]]
    assert models == ["pinhole", None, "pinhole_radial_k1"]
    assert (
        packed[0]["ptr_wrapper"]["data"].keys()
        == openmvg()["views"][0]["value"]["ptr_wrapper"]["data"].keys()
    )


def test_what_is_written_for_alicevision_has_all_that_its_reader_asks_for(tmp_path: Path) -> None:
    problem = problem_of(tmp_path, "cameras.sfm")
    problem.set_free_intrinsics()
    write(problem, tmp_path / "again.sfm")
    (lens,) = json.loads((tmp_path / "again.sfm").read_text())["intrinsics"]
    assert {
        "serialNumber",
        "sensorWidth",
        "sensorHeight",
        "type",
        "locked",
        *alicevision()["intrinsics"][0],
    } <= {*lens}
    assert (lens["type"], lens["locked"]) == ("brown", "1")
    assert read(tmp_path / "again.sfm").fixed_intrinsics.all()


@pytest.mark.parametrize(
    ("target", "names", "told"),
    [
        (
            "sfm_data.json",
            ("aspect",),
            r"intrinsics\[0\]: no supported camera model \(pinhole, .* has .*aspect",
        ),
        ("a.sfm", ("skew",), r"no supported camera model \(pinhole, radial1, .*skew = 0\.5"),
        ("a.sfm", ("k4",), r"k4 = 0\.5"),
        ("a.g2o", ("skew",), r"intrinsics\[0\]: skew = 0\.5 cannot be kept in g2o's files"),
    ],
)
def test_lenses_that_a_file_cannot_hold_are_named_and_nothing_is_left(
    tmp_path: Path, target: str, names: tuple[str, ...], told: str
) -> None:
    problem = sfmcpp.circle_scene(3, 5, camera_model="perspective", seed=0)
    problem.intrinsics[0, [problem.intrinsic_names.index(name) for name in names]] = 0.5
    with pytest.raises(DatasetError, match=told):
        write(problem, tmp_path / target)
    assert not (tmp_path / target).exists()


@pytest.mark.parametrize("target", ["a.sfm", "a.g2o"])
def test_focal_lengths_that_no_reader_takes_are_not_written(tmp_path: Path, target: str) -> None:
    problem = sfmcpp.circle_scene(3, 5, camera_model="perspective", seed=0)
    problem.intrinsics[1, 0] = -700
    with pytest.raises(DatasetError, match=r"intrinsics\[1\]: f = -700\.0.*: must be positive"):
        write(problem, tmp_path / target)


def test_what_visualsfm_cannot_name_is_refused_and_nothing_is_left(tmp_path: Path) -> None:
    problem = problem_of(tmp_path, "model.nvm")
    problem.metadata.image_names = ["one", "two\nlines", "three"]
    with pytest.raises(sfmcpp.DatasetError, match=r"image name 'two\\nlines': must be one line"):
        write(problem, tmp_path / "written.nvm")
    assert not (tmp_path / "written.nvm").exists()


def test_measurements_of_visualsfm_keep_their_distortion_in_the_metadata(tmp_path: Path) -> None:
    problem = problem_of(tmp_path, "model.nvm")
    np.testing.assert_array_equal(problem.metadata.extra["nvm_measurement_distortion"], [MEASURED] * 3)
    np.testing.assert_array_equal(problem.metadata.extra["nvm_keys"], [4 + camera for camera, _ in SEEN])
    plain = problem_of(tmp_path, "model.nvm", nvm(0.0))
    np.testing.assert_allclose(plain.pixels, problem.pixels, rtol=0, atol=1e-9)
    assert problem.metadata.point_colors is not None
    assert problem.metadata.point_colors[3].tolist() == [3, 1, 2]


@pytest.mark.parametrize(
    ("version", "focal"),
    [
        ([1, 1, 0], {"pxFocalLength": FOCAL, "principalPoint": list(CENTRE)}),
        ([1, 2, 0], {"pxFocalLength": [FOCAL, 1.25 * FOCAL], "principalPoint": list(CENTRE)}),
        ([1, 2, 4], {"pixelRatio": 0.8}),
        ([1, 2, 6], {"pixelRatio": 1.25}),
    ],
)
def test_versions_of_alicevision_tell_focal_lengths_and_centres_in_their_ways(
    tmp_path: Path, version: list[int], focal: dict[str, Any]
) -> None:
    content = alicevision() | {"version": version}
    content["intrinsics"][0] |= focal
    problem = problem_of(tmp_path, "cameras.sfm", json.dumps(content))
    lens = dict(zip(problem.intrinsic_names, problem.intrinsics[0], strict=True))
    assert lens["f"] == pytest.approx(FOCAL, rel=1e-15)
    assert lens["aspect"] == pytest.approx(1.0 if version == [1, 1, 0] else 1.25, rel=1e-15)
    assert (lens["cx"], lens["cy"]) == CENTRE


def test_json_is_told_by_its_contents(tmp_path: Path) -> None:
    for name, source in (("sfm_data.json", "openmvg"), ("cameras.sfm", "alicevision")):
        other = tmp_path / f"{source}.json"
        other.write_text(FILES[name]())
        assert read(other).metadata.source_format == source


def test_a_pipe_named_like_a_document_is_refused_without_waiting(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "sfm_data.json")
    with pytest.raises(DatasetError, match="is not a regular file"):
        read(tmp_path / "sfm_data.json")


def changed(content: dict[str, Any], change: Callable[[dict[str, Any]], object]) -> str:
    copy = deepcopy(content)
    change(copy)
    return json.dumps(copy)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda c: c.update(sfm_data_version="9"), r"sfm_data_version: '9': must be 0\.2 or 0\.3"),
        (lambda c: c["views"][2]["value"]["ptr_wrapper"].pop("data"), r"views\[2\].*lacks 'data'"),
        (lambda c: c["extrinsics"][1]["value"]["rotation"][0].append(1), r"extrinsics\[1\].*9 numbers"),
        (lambda c: c["extrinsics"][1]["value"].update(rotation=[[1, 2, 3]] * 3), "no rotation matrix"),
        (lambda c: c["views"][1].update(key=10), r"views\[1\]: id 10 is used twice"),
        (lambda c: c["views"][1]["value"]["ptr_wrapper"]["data"].update(id_pose=20), "share pose 20: rigs"),
        (lambda c: c["intrinsics"][0]["value"].update(polymorphic_name="fisheye"), "'fisheye': must be one"),
        (lambda c: c["intrinsics"][0]["value"].pop("polymorphic_name"), "no class that was named"),
        (lambda c: c["structure"][0]["value"]["observations"][0].update(key=13), "view 13, which has no"),
        (lambda c: c["structure"][0]["value"]["observations"].append(
            c["structure"][0]["value"]["observations"][0]), "observes this point twice"),
        (lambda c: c["structure"][4]["value"].update(X=[1, 2, "x"]), r"structure\[4\]\.value\.X\[2\]: 'x'"),
        (lambda c: c["structure"][4]["value"].update(X=[1, 2, 1e200]), "finite number"),
    ],
)  # fmt: skip
def test_damage_of_openmvg_is_named_with_its_place(
    tmp_path: Path, change: Callable[[dict[str, Any]], object], told: str
) -> None:
    with pytest.raises(DatasetError, match=told):
        problem_of(tmp_path, "sfm_data.json", changed(openmvg(), change))


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda c: c.update(rigs=[{"rigId": "1"}]), "rigs: rigs are not supported yet"),
        (lambda c: c["intrinsics"][0].update(type="equidistant"), "'equidistant': must be one of"),
        (lambda c: c["intrinsics"][0].update(sensorWidth="0"), r"intrinsics\[0\]: .*must be positive"),
        (lambda c: c["structure"][0]["observations"][0].pop("x"), "exported with its features"),
        (lambda c: c["structure"][2].update(color=["0", "256", "1"]), "from 0 to 255"),
        (lambda c: c["structure"][2].update(color=["0"]), r"structure\[2\]\.color: a list of 1: must be 3"),
    ],
)
def test_damage_of_alicevision_is_named_with_its_place(
    tmp_path: Path, change: Callable[[dict[str, Any]], object], told: str
) -> None:
    with pytest.raises(DatasetError, match=told):
        problem_of(tmp_path, "cameras.sfm", changed(alicevision(), change))


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("NVM_V3 ", "NVM_V3_R9T", ":1: the first line must be NVM_V3"),
        ("NVM_V3 ", "NVM_V3 FixedK 1 2 3 4 5", ":1: the first line must be NVM_V3"),
        ("a.jpg 800.0", "a.jpg -800.0", r":4: focal length -800: must be positive"),
        ("a.jpg 800.0 ", "a.jpg ", ":4: the line must hold a name and 10 numbers"),
        ("\n20\n", "\n21\n", ":30: the line holds 1 numbers: must be 7"),
        ("\n20\n", "\n19\n", ":28: another model begins here"),
        ("\n0\n", "\n2\n", ":30: another model begins here"),
        ("0 1 2 ", "0 1 256 ", ":9: colour 256"),
        ("\n3\n", "\n90\n", "truncated: 90 cameras"),
    ],
)
def test_damage_of_visualsfm_is_named_with_its_line(tmp_path: Path, old: str, new: str, told: str) -> None:
    text = nvm()
    assert old in text
    with pytest.raises(DatasetError, match=told):
        problem_of(tmp_path, "model.nvm", text.replace(old, new, 1))


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ('{"sfm_data_version": "0.3",\n "views": [}', ":2: is no JSON"),
        ('{"sfm_data_version": NaN}', "NaN is no finite number"),
        ('{"sfm_data_version": ' + "[" * 100_000, "nested too deeply"),
        ('{"sfm_data_version": "0.3", "views": 3}', "extrinsics|views"),
    ],
)
def test_what_is_no_json_is_refused(tmp_path: Path, text: str, told: str) -> None:
    with pytest.raises(DatasetError, match=told):
        problem_of(tmp_path, "sfm_data.json", text)
