"""NPZ: nothing lost, and every kind of damage refused."""

from __future__ import annotations

import io
import json
import re
import tempfile
import zipfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from io_helpers import (
    PROPERTY,
    assert_same_bits,
    assert_valid_or_refused,
    mutated,
    no_warnings,
    random_problem,
    refusal,
)
from sfmcpp import CAMERA_MODELS, DatasetError, Problem, circle_scene, rig_walk_scene
from sfmcpp.errors import SfmcppError
from sfmcpp.sources.io import read, write
from sfmcpp.sources.io.files import MAX_EXPANDED
from sfmcpp.sources.io.npz import members_of_problem, write_members


@pytest.mark.filterwarnings("ignore:Duplicate name")
@pytest.mark.parametrize("again", ["cameras.npy", "points"])
def test_two_members_of_one_name_are_refused(tmp_path: Path, again: str) -> None:
    path = tmp_path / "twice.npz"
    write(circle_scene(6, 30), path)
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr(again, archive.read(again.removesuffix(".npy") + ".npy"))
    assert re.search("has 2 members called '(cameras|points)': each must be there once", str(refusal(path)))


def full_problem(seed: int, model: str = "perspective", covariances: bool = False) -> Problem:
    """Random problem with all kinds of metadata and every optional array; one of σ and Σ."""
    rng = np.random.default_rng(seed)
    varying = dict.fromkeys(CAMERA_MODELS[model].intrinsics, 0.5)
    problem = random_problem(seed, model, varying, least=2, shared=True)
    for name in ("fixed_cameras", "fixed_points", "fixed_intrinsics"):
        mask = getattr(problem, name)
        setattr(problem, name, rng.random(mask.shape) < 0.5)
    problem.sigma_px = rng.uniform(0.1, 9, problem.num_observations)
    if covariances:
        problem.covariance_px2 = problem.sigma_px[:, None, None] * np.array([[2, -0.3], [-0.3, 0.5]])
        problem.sigma_px = None
    metadata = problem.metadata
    metadata.source_format = "elsewhere"
    metadata.image_names = [f"bild ä {i}" for i in range(problem.num_cameras)]
    metadata.image_sizes = rng.integers(1, 999, (problem.num_cameras, 2))
    metadata.extra = {"keys": rng.integers(0, 9, 4), "names": ["a", "b\0"], "deep": {"x": [1, None, 0.1]}}
    return problem


@PROPERTY
@given(st.integers(0, 2**32), st.sampled_from(sorted(CAMERA_MODELS)), st.booleans())
def test_every_bit_survives_writing_and_reading(seed: int, model: str, covariances: bool) -> None:
    problem = full_problem(seed, model, covariances)
    with tempfile.TemporaryDirectory() as folder, no_warnings():
        write(problem, Path(folder) / "x.npz")
        again = read(Path(folder) / "x.npz")
    assert_same_bits(again, problem)


def test_numpy_reads_the_arrays_without_pickle(tmp_path: Path) -> None:
    problem = full_problem(2)
    write(problem, tmp_path / "x.npz")
    with np.load(tmp_path / "x.npz", allow_pickle=False) as archive:
        np.testing.assert_array_equal(archive["points"], problem.points)
        assert json.loads(archive["metadata"].tobytes())["camera_model"] == "perspective"


def rewritten(folder: Path, change: Callable[[dict[str, Any]], object]) -> Path:
    """Write a problem with NumPy's own writer after `change` has edited its arrays."""
    write(full_problem(3), folder / "x.npz")
    with np.load(folder / "x.npz") as archive:
        arrays = dict(archive)
    change(arrays)
    np.savez(folder / "x.npz", **arrays)
    return folder / "x.npz"


def with_header(**changed: object) -> Callable[[dict[str, Any]], object]:
    """Make a change of the JSON header."""

    def change(arrays: dict[str, Any]) -> None:
        text = json.dumps(json.loads(arrays["metadata"].tobytes()) | changed)
        arrays["metadata"] = np.frombuffer(text.encode(), np.uint8)

    return change


def with_value(name: str, value: float) -> Callable[[dict[str, Any]], object]:
    """Make a change of the first element of an array."""
    return lambda arrays: arrays[name].flat.__setitem__(0, value)


def with_array(name: str, value: object) -> Callable[[dict[str, Any]], object]:
    """Make a replacement of a whole array."""
    return lambda arrays: arrays.__setitem__(name, np.asarray(value))


def with_the_first_observation_twice(arrays: dict[str, Any]) -> None:
    """Give the second observation the camera and point of the first."""
    for name in ("camera_index", "point_index"):
        arrays[name][1] = arrays[name][0]


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda arrays: arrays.pop("points"), "it lacks points"),
        (lambda arrays: arrays.pop("metadata"), "it lacks metadata"),
        (with_header(sfmcpp_problem=2), "no sfmcpp problem of version 1"),
        (with_header(camera_model="fisheye"), "must be one of calibrated"),
        (with_header(camera_model=7), "'camera_model' must be a str"),
        (with_header(image_names=[1, 2]), "'image_names' must be a list of str"),
        (with_header(image_names=["a"] * 99), "image_names has 99 entries"),
        (with_array("metadata", np.zeros(3, np.uint8)), "metadata is not JSON"),
        (with_array("metadata", np.full(9999, ord("["), np.uint8)), "metadata is not JSON"),
        (with_array("points", np.zeros((4, 2))), r"points: shape \(4, 2\)"),
        (with_array("points", np.zeros((4, 3), complex)), "points: dtype complex128"),
        (with_array("point_colors", np.zeros((1, 3))), "point_colors is float64"),
        (with_value("image_sizes", -1), "metadata image_sizes has -1: must be from 0 to 2147483647 px"),
        (with_value("image_sizes", 2**40), "metadata image_sizes has 1099511627776: must be from 0"),
        (with_value("points", np.nan), r"points\[0, 0\] is nan: must be finite"),
        (with_value("pixels", np.inf), "must be finite"),
        (with_value("camera_index", 99), r"camera_index\[0\] is 99"),
        (with_value("point_index", -1), r"point_index\[0\] is -1"),
        (with_value("intrinsics_index", 99), r"intrinsics_index\[0\] is 99"),
        (with_value("sigma_px", 0), r"sigma_px\[0\] is 0.0: must be positive"),
        (with_value("cameras", 2), r"cameras\[0\]: its first three columns are not a rotation"),
        (with_the_first_observation_twice, "observations 0 and 1 are of the same"),
    ],
)
def test_impossible_contents_are_refused(
    tmp_path: Path, change: Callable[[dict[str, Any]], object], reason: str
) -> None:
    error = refusal(rewritten(tmp_path, change))
    with pytest.raises(DatasetError, match=reason):
        raise error


def test_pickled_arrays_are_refused(tmp_path: Path) -> None:
    path = rewritten(tmp_path, with_array("points", np.array([{"a": 1}], dtype=object)))
    assert "not a valid .npz archive" in str(refusal(path))


def test_declared_sizes_are_checked_before_memory_is_taken(tmp_path: Path) -> None:
    header = io.BytesIO()
    shape = {"descr": "<f8", "fortran_order": False, "shape": (10**15, 3)}
    np.lib.format.write_array_header_1_0(header, shape)
    rewritten(tmp_path, lambda arrays: arrays.pop("points"))
    with zipfile.ZipFile(tmp_path / "x.npz", "a") as archive:
        archive.writestr("points.npy", header.getvalue())
    assert "0 bytes are not (1000000000000000, 3) of float64" in str(refusal(tmp_path / "x.npz"))


def test_headers_that_numpy_warns_about_are_refused_without_a_warning(tmp_path: Path) -> None:
    header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (0L, 3L), }\n"
    rewritten(tmp_path, lambda arrays: arrays.pop("points"))
    with zipfile.ZipFile(tmp_path / "x.npz", "a") as archive:
        archive.writestr("points.npy", b"\x93NUMPY\1\0" + len(header).to_bytes(2, "little") + header)
    told = "not a valid .npz archive (ValueError: an array has a header of Python 2)"
    assert told in str(refusal(tmp_path / "x.npz"))


def test_zip_bombs_are_refused(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "x.npz", "w", zipfile.ZIP_LZMA) as archive:
        archive.writestr("points.npy", bytes(80 << 20))
    assert f"{MAX_EXPANDED} allows more" in str(refusal(tmp_path / "x.npz"))


def test_members_of_an_unknown_version_are_named(tmp_path: Path) -> None:
    rewritten(tmp_path, lambda arrays: arrays.pop("points"))
    member = io.BytesIO()
    np.lib.format.write_array(member, np.ones((4, 3)), version=(3, 0))
    with zipfile.ZipFile(tmp_path / "x.npz", "a") as archive:
        archive.writestr("points.npy", member.getvalue())
    assert "npy version 3.0: must be 1.0 or 2.0" in str(refusal(tmp_path / "x.npz"))


@pytest.mark.parametrize("content", [b"garbage", b"\x93NUMPY\1\0", b"PK", b"PK\3\4" + bytes(50)])
def test_what_is_no_archive_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "x.npz").write_bytes(content)
    reason = "not a valid .npz archive" if content.startswith(b"PK") else "wrong magic"
    assert reason in str(refusal(tmp_path / "x.npz"))


@pytest.mark.parametrize("value", [object(), np.array([None]), float("nan"), {1, 2}])
def test_metadata_that_needs_pickle_is_refused(tmp_path: Path, value: object) -> None:
    problem = full_problem(4)
    problem.metadata.extra["odd"] = value
    with pytest.raises(DatasetError, match="metadata"):
        write(problem, tmp_path / "x.npz")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "value", "rule"),
    [
        ("colmap_loose_image", np.array([0]), "differ in length: colmap_loose_image 1"),
        ("colmap_loose_pixels", np.empty((0, 2)), "colmap_loose_keypoint_index 2, colmap_loose_pixels 0"),
        ("colmap_loose_pixels", np.array([1.0, 2.0]), "shape (2,), must be (any, 2)"),
        ("colmap_loose_pixels", np.array([[1j, 2], [3, 4]]), "complex128, must be numbers"),
        ("colmap_keypoint_index", np.array([0.5, 1.0]), "float64, must be integers"),
        ("colmap_keypoint_index", np.array(7), "shape (), must be (any)"),
        ("bundler_registered", np.array([2, 3]), "int64, must be booleans"),
        ("colmap_second_sightings", np.array([[1, 2]]), "shape (1, 2), must be (any, 3)"),
        (
            "colmap_camera_models",
            np.ones((9, 9)),
            "1., 1., 1.]]): must be a list of str",
        ),
        ("origin_xyz_m", np.ones((2, 3)), "shape (2, 3), must be (3)"),
        ("origin_geodetic", np.array([46.5, np.nan, 0]), "[1] = nan: must be finite"),
    ],
)
def test_known_metadata_of_another_kind_or_length_are_refused(
    tmp_path: Path, name: str, value: NDArray[Any], rule: str
) -> None:
    problem = circle_scene(3, 12)
    problem.metadata.extra = {
        "colmap_loose_image": np.array([0, 1]),
        "colmap_loose_keypoint_index": np.bincount(problem.camera_index)[:2],
        "colmap_loose_pixels": np.ones((2, 2)),
    }
    members = members_of_problem(problem, tmp_path)
    write_members(members | {f"extra.{name}": value}, tmp_path / "x.npz")
    error = refusal(tmp_path / "x.npz")
    assert name in str(error)
    assert rule in str(error)
    assert "\n" not in str(error)
    problem.metadata.extra[name] = value
    for call in (partial(write, problem, tmp_path / "model"), lambda: problem.with_observations([0])):
        with pytest.raises(SfmcppError, match=re.escape(rule)):
            call()


@pytest.mark.parametrize("value", [3, "SIMPLE_RADIAL", [1], {"a": 1}, None])
def test_known_metadata_that_are_no_texts_are_refused(tmp_path: Path, value: object) -> None:
    problem = circle_scene(3, 12)
    problem.metadata.extra["colmap_camera_models"] = value
    with pytest.raises(DatasetError, match=r"colmap_camera_models = .*: must be a list of str"):
        write(problem, tmp_path / "x.npz")


@PROPERTY
@given(st.integers(0, 2**32))
def test_members_damaged_behind_a_right_checksum_are_read_or_refused(seed: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "x.npz"
        write(full_problem(5), path)
        with zipfile.ZipFile(path) as archive:
            members = {name: archive.read(name) for name in archive.namelist()}
        victim = sorted(members)[seed % len(members)]
        members[victim] = mutated(members[victim], seed)
        with zipfile.ZipFile(path, "w") as archive:
            for name, content in members.items():
                archive.writestr(name, content)
        assert_valid_or_refused(path)


def test_rigs_are_kept(tmp_path: Path) -> None:
    problem = rig_walk_scene(6, 100, seed=0)
    write(problem, tmp_path / "x.npz")
    again = read(tmp_path / "x.npz")
    assert again.rigs is not None
    assert problem.rigs is not None
    for name in ("sensors", "frame_of_camera", "sensor_of_camera"):
        np.testing.assert_array_equal(getattr(again.rigs, name), getattr(problem.rigs, name))


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("sensors", None, "its rigs lack rigs.sensors"),
        ("sensors", np.ones((3, 3, 4)), r"rigs.sensors\[0\]: not a rotation"),
        ("sensor_of_camera", np.zeros(6, np.int32), "rigs: frame 0 has sensor 0 twice"),
        ("frame_of_camera", np.full(6, 6, np.int32), r"rigs.frame_of_camera\[0\] = 6: must be in \[0, 6\)"),
        ("frame_of_camera", np.zeros(5, np.int32), "6 values for 5 cameras"),
    ],
)
def test_rigs_that_cannot_be_are_refused(
    tmp_path: Path, name: str, value: np.ndarray | None, reason: str
) -> None:
    path = tmp_path / "x.npz"
    write(rig_walk_scene(6, 100, seed=0), path)
    members = dict(np.load(path))
    del members[f"rigs.{name}"]
    np.savez(path, **members, **({} if value is None else {f"rigs.{name}": value}))
    with pytest.raises(DatasetError, match=reason):
        read(path)
