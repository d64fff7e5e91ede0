"""Tracks of uncalibrated images: the same from every kind of file, and what is wrong is named."""

from __future__ import annotations

import gzip
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.io import savemat

import sfmcpp
from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.model.image_tracks import ImageTracks, image_tracks
from sfmcpp.sources.io.image_tracks import read_image_tracks
from sfmcpp.sources.io.track_files import CameraTracks, write_tracks

IMAGES, TRACKS = 4, 30

Writer = Callable[[Path, ImageTracks], Path]


def random_tracks() -> ImageTracks:
    rng = np.random.default_rng(3)
    seen = rng.uniform(size=(TRACKS, IMAGES)) < 0.6
    seen[:, 1] |= ~seen.any(axis=1)
    track, image = np.nonzero(seen)
    return image_tracks(image, track, rng.uniform(0, 500, (len(track), 2)))


def matrix_of(tracks: ImageTracks) -> NDArray[np.float64]:
    """(N, n, 2) pixels, −1 where not seen."""
    matrix = np.full((tracks.num_tracks, tracks.num_images, 2), -1.0)
    matrix[tracks.track_index, tracks.image_index] = tracks.pixels
    return matrix


def as_vgg(folder: Path, tracks: ImageTracks) -> Path:
    path = folder / "viff.xy"
    np.savetxt(path, matrix_of(tracks).reshape(tracks.num_tracks, -1), fmt="%.17g")
    return path


def as_compressed_vgg(folder: Path, tracks: ImageTracks) -> Path:
    path = folder / "viff.xy.gz"
    path.write_bytes(gzip.compress(as_vgg(folder, tracks).read_bytes()))
    return path


def as_table(folder: Path, tracks: ImageTracks) -> Path:
    path = folder / "tracks.txt"
    np.savetxt(
        path, np.c_[tracks.image_index + 3, 7 * tracks.track_index, tracks.pixels], "%d %d %.17g %.17g"
    )
    return path


def as_swapped_table(folder: Path, tracks: ImageTracks) -> Path:
    path = folder / "tracks.txt"
    np.savetxt(path, np.c_[tracks.track_index, tracks.image_index, tracks.pixels], "%d %d %.17g %.17g")
    return path


def as_named_table(folder: Path, tracks: ImageTracks) -> Path:
    path = folder / "tracks.csv"
    columns = np.c_[tracks.track_index, tracks.image_index, tracks.pixels]
    rows = "\n".join(f"{int(t)},{int(i)},{x!r},{y!r}" for t, i, x, y in columns.tolist())
    path.write_text(f"track,image,x,y\n{rows}\n", encoding="ascii")
    return path


def as_arrays(folder: Path, tracks: ImageTracks) -> Path:
    path = folder / "tracks.npz"
    np.savez(path, camera_index=tracks.image_index, point_index=tracks.track_index, pixels=tracks.pixels)
    return path


def as_camera_tracks(folder: Path, tracks: ImageTracks) -> Path:
    path = folder / "tracks.csv"
    times, intrinsics = np.arange(tracks.num_images) / 10, np.array([700.0, 1, 320, 240, 0])
    found = CameraTracks(times, tracks.image_index, tracks.track_index, tracks.pixels, intrinsics)
    write_tracks(found, path)
    return path


def as_mat_files(folder: Path, tracks: ImageTracks) -> Path:
    for image in range(tracks.num_images):
        rows = tracks.image_index == image
        seen = np.c_[tracks.track_index[rows] + 1, tracks.pixels[rows], np.zeros((rows.sum(), 3))]
        savemat(folder / f"Image{image + 9}.mat", {"Image": np.vstack([np.full(6, 0.1), seen])})
    return folder


def as_problem(folder: Path, tracks: ImageTracks) -> Path:
    path = folder / "problem.npz"
    sfmcpp.write(problem_of(tracks), path)
    return path


def as_bal(folder: Path, tracks: ImageTracks) -> Path:
    path = folder / "problem.txt.gz"
    sfmcpp.write(problem_of(tracks), path)
    return path


def problem_of(tracks: ImageTracks) -> sfmcpp.Problem:
    """Cameras and points that have nothing to do with the observations."""
    cameras = np.tile(np.eye(3, 4), (tracks.num_images, 1, 1))
    intrinsics = np.tile([500.0, 0, 0], (tracks.num_images, 1))
    points = np.ones((tracks.num_tracks, 3))
    return sfmcpp.Problem(
        "bal", cameras, intrinsics, points, tracks.image_index, tracks.track_index, tracks.pixels
    )


@pytest.mark.parametrize(
    "write",
    [
        as_vgg,
        as_compressed_vgg,
        as_table,
        as_swapped_table,
        as_named_table,
        as_arrays,
        as_camera_tracks,
        as_mat_files,
        as_problem,
        as_bal,
    ],
)
def test_every_kind_of_file_holds_the_same_tracks(tmp_path: Path, write: Writer) -> None:
    tracks = random_tracks()
    found = read_image_tracks(write(tmp_path, tracks))
    np.testing.assert_array_equal(matrix_of(found), matrix_of(tracks))
    assert len(set(found.names)) == IMAGES


def test_numbers_of_tracks_have_no_gaps(tmp_path: Path) -> None:
    (tmp_path / "t.txt").write_text("0 5 1 1\n0 900 2 2\n1 5 3 3\n", encoding="ascii")
    found = read_image_tracks(tmp_path / "t.txt")
    assert found.track_index.tolist() == [0, 1, 0]


def test_names_and_sizes_of_an_archive_are_kept(tmp_path: Path) -> None:
    tracks, sizes = random_tracks(), np.tile([640, 480], (IMAGES, 1))
    arrays = {"camera_index": tracks.image_index, "point_index": tracks.track_index, "pixels": tracks.pixels}
    np.savez(tmp_path / "t.npz", **arrays, names=np.array(list("abcd")), image_sizes=sizes)
    found = read_image_tracks(tmp_path / "t.npz")
    assert found.names == list("abcd")
    np.testing.assert_array_equal(found.sizes, sizes)
    np.testing.assert_array_equal(found.centres, sizes / 2)


def test_images_of_a_problem_without_names_are_called_as_in_a_model_of_it(tmp_path: Path) -> None:
    """They were numbered from 0, and those of models from 1: `evaluate` compared each with the next one."""
    path = as_bal(tmp_path, random_tracks())
    sfmcpp.convert(path, tmp_path / "model")
    assert read_image_tracks(path).names == sfmcpp.read(tmp_path / "model").metadata.image_names


def test_pixels_of_bal_are_counted_from_the_centre(tmp_path: Path) -> None:
    assert not read_image_tracks(as_bal(tmp_path, random_tracks())).centres.any()
    assert np.isnan(read_image_tracks(as_vgg(tmp_path, random_tracks())).centres).all()


@pytest.mark.parametrize("name", ["t.txt", "t.out", "t.nvm", "t.npz"])
def test_pixels_of_bal_cameras_are_counted_from_the_centre_in_all_formats(tmp_path: Path, name: str) -> None:
    sfmcpp.write(sfmcpp.circle_scene(4, 30, camera_model="bal"), tmp_path / name)
    found = read_image_tracks(tmp_path / name)
    assert np.abs(found.pixels.mean(axis=0)).max() < 50
    np.testing.assert_array_equal(found.centres, np.zeros((4, 2)))


@pytest.mark.parametrize(
    ("name", "text", "reason"),
    [
        ("t.xy", "1 2 3 4\n1 2\n", ":2: the line holds 2 numbers"),
        ("t.xy", "1 2 3\n", ":1: the line holds 3 numbers"),
        ("t.xy", "-1 -1 -1 -1\n", "no observations"),
        ("t.xy", "1 2 x 4\n", ":1: 'x' is not a finite number"),
        ("t.txt", "0 0 1 1\n0 1 1\n", ":2: the line holds 3 numbers"),
        ("t.txt", "image track x y\n0 0 1 1\n0 0 2 2\n1 1 5 5\n", ":3: image 0 sees track 0 twice"),
        ("t.txt", "0 -1 1 1\n", ":1: image or track -1"),
        ("t.txt", "0 1.5 1 1\n", ":1: image or track 1.5"),
        ("t.csv", "image,track,x,y\n", "no observations"),
        ("t.xy", "1 2 3 4\n1 2 1e10 4\n", ":2: pixel 1e+10: must be at most 2147483646 in magnitude"),
        ("t.txt", "0 0 1 1\n0 1 -1e300 1\n", ":2: pixel -1e+300: must be at most 2147483646"),
        ("t.jpg", "1 2 3 4\n", "its name tells no format"),
        ("t.npz", "0 0 1 1\n", "wrong magic"),
        ("t.txt", "", "the file is empty"),
    ],
)
def test_what_is_wrong_with_a_text_is_named(tmp_path: Path, name: str, text: str, reason: str) -> None:
    (tmp_path / name).write_text(text, encoding="ascii")
    with pytest.raises(DatasetError, match=re.escape(reason)):
        read_image_tracks(tmp_path / name)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"pixels": None}, "lacks the arrays pixels"),
        ({"pixels": np.full((2, 2), np.nan)}, "must be finite"),
        ({"pixels": np.zeros((3, 2))}, "must be 3 integers"),
        ({"camera_index": np.array([0.0, 1.0])}, "must be 2 integers"),
        ({"camera_index": np.array([0, -1])}, "must be from 0"),
        ({"camera_index": np.array([0, 0])}, "sees track 0 twice"),
        ({"names": np.array(["a", "a"])}, "must all be different"),
        ({"pixels": np.full((2, 2), 1e10)}, "pixels[0]: pixel 1e+10: must be at most 2147483646"),
        ({"names": np.array(["a\nb", "a"])}, "image name 'a\\nb': must not"),
        ({"names": np.array(["a"])}, "there are 1 names"),
        ({"image_sizes": np.ones((3, 2), dtype=int)}, "must be (2, 2)"),
    ],
)
def test_what_is_wrong_with_an_archive_is_named(
    tmp_path: Path, change: dict[str, NDArray[np.generic] | None], reason: str
) -> None:
    arrays = {"camera_index": np.array([0, 1]), "point_index": np.zeros(2, int), "pixels": np.ones((2, 2))}
    np.savez(tmp_path / "t.npz", **{k: v for k, v in {**arrays, **change}.items() if v is not None})
    with pytest.raises(DatasetError, match=re.escape(reason)):
        read_image_tracks(tmp_path / "t.npz")


@pytest.mark.parametrize(
    ("matrix", "reason"),
    [
        (np.ones((2, 5)), "must be (rows, 6)"),
        (np.ones((2, 6, 1)), "must be numbers"),
        (np.array([["a"]]), "must be an array of real numbers"),
        (np.full((2, 6), np.nan), "must be finite"),
        (np.full((2, 6), 0.5), "must be a point's number"),
        (np.ones((3, 6)), "sees track 0 twice"),
    ],
)
def test_what_is_wrong_with_a_mat_file_is_named(
    tmp_path: Path, matrix: NDArray[np.generic], reason: str
) -> None:
    savemat(tmp_path / "Image1.mat", {"Image": matrix})
    with pytest.raises(DatasetError, match=re.escape(reason)):
        read_image_tracks(tmp_path)


def test_arrays_that_contradict_each_other_are_refused() -> None:
    with pytest.raises(InvalidArgument, match="sees track 1 twice"):
        image_tracks([0, 0], [1, 1], np.zeros((2, 2)))


@pytest.mark.real
@pytest.mark.parametrize(
    ("path", "sizes"),
    [
        ("dinosaur/viff.xy", (36, 4983, 16432)),
        ("malaga/Malaga", (170, 58404, 167285)),
        ("bal/ladybug-49-shrink-1800.txt", (49, 1800, 10863)),
    ],
)
def test_real_sets_have_their_known_sizes(data_dir: Path, path: str, sizes: tuple[int, int, int]) -> None:
    found = read_image_tracks(data_dir / path)
    assert (found.num_images, found.num_tracks, len(found)) == sizes


@pytest.mark.real
def test_hostile_mat_files_end_in_an_error_that_names_them(data_dir: Path, tmp_path: Path) -> None:
    files = sorted((data_dir / "hostile").glob("*.mat"))
    assert files
    for file in files:
        (tmp_path / "Image1.mat").write_bytes(file.read_bytes())
        with pytest.raises(DatasetError, match=r"Image1\.mat"):
            read_image_tracks(tmp_path)
