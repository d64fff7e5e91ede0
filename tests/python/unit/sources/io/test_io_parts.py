"""Parts: nothing lost when they are joined, each rule of the folder kept, and files cut for several ranks."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from io_helpers import PROPERTY, assert_same_bits, assert_same_problem, refusal
from sfmcpp import CAMERA_MODELS, InvalidArgument, Problem, circle_scene
from sfmcpp.ba.partition import partition_points
from sfmcpp.ba.parts import joined_parts, part_of
from sfmcpp.sources.io import read, write
from sfmcpp.sources.io.files import read_own_bytes
from sfmcpp.sources.io.number_text import OwnNumbers
from sfmcpp.sources.io.parts import LIST, PartsFolder, read_parts, write_parts
from test_io_npz import full_problem


@PROPERTY
@given(st.integers(0, 2**32), st.sampled_from(sorted(CAMERA_MODELS)), st.booleans(), st.integers(1, 5))
def test_parts_joined_are_the_problem_to_the_last_bit(
    seed: int, model: str, covariances: bool, count: int
) -> None:
    problem = full_problem(seed, model, covariances)
    # Observations in any order.
    problem = problem.with_observations(np.random.default_rng(seed).permutation(problem.num_observations))
    with tempfile.TemporaryDirectory() as folder:
        write_parts(problem, Path(folder) / "parts", count)
        again = read(Path(folder) / "parts")
    assert_same_bits(again, problem)


def street(seed: int) -> Problem:
    """Sixty cameras in a row, each point seen by three to six that follow one another; all in any order."""
    rng = np.random.default_rng(seed)
    names, first = rng.permutation(60), rng.integers(0, 54, 2000)
    images = rng.integers(3, 7, 2000)
    point_index = np.repeat(np.arange(2000), images)
    camera = names[np.concatenate([np.arange(f, f + k) for f, k in zip(first, images, strict=True)])]
    truth = circle_scene(60, 2000, seed=seed)
    pixels = np.zeros((len(camera), 2))
    return replace(truth, camera_index=camera, point_index=point_index, pixels=pixels, sigma_px=None)


def test_parts_take_the_same_work_and_see_few_cameras() -> None:
    problem = street(1)
    parts = partition_points(problem, 4)
    images = np.bincount(problem.point_index)
    work = np.bincount(parts, images * (images + 32.0))
    assert work.max() < 1.02 * work.mean()
    of_observations = parts[problem.point_index]
    assert all(len(np.unique(problem.camera_index[of_observations == k])) <= 25 for k in range(4))
    joined = joined_parts([part_of(problem, np.flatnonzero(parts == k)) for k in range(4)])
    assert_same_problem(joined, problem)


def a_folder(tmp_path: Path) -> Path:
    """Write a scene in three parts."""
    folder = tmp_path / "scene.parts"
    write_parts(circle_scene(6, 60, seed=3), folder, 3)
    return folder


def test_a_folder_written_again_has_the_files_of_the_new_problem_alone(tmp_path: Path) -> None:
    folder = a_folder(tmp_path)
    problem = circle_scene(5, 40, seed=4)
    write(problem, folder)
    assert_same_problem(read(folder), problem)
    listed = json.loads((folder / LIST).read_text())
    names = {entry["name"] for entry in (listed["cameras"], *listed["parts"])}
    assert {path.name for path in folder.iterdir()} == names | {LIST}


def change_list(change: Callable[[dict], object]) -> Callable[[Path], object]:
    """Make a change of the list of a folder."""

    def apply(folder: Path) -> None:
        listed = json.loads((folder / LIST).read_text())
        change(listed)
        (folder / LIST).write_text(json.dumps(listed))

    return apply


def flip_a_byte_of_a_part(folder: Path) -> None:
    """Damage a part where only its checksum tells."""
    path = next(folder.glob("part-0001*"))
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


def put_a_part_in_the_place_of_another(folder: Path) -> None:
    """Take a part of another problem of the same size."""
    other = folder / "other"
    write_parts(circle_scene(6, 60, seed=3), other, 3)
    scene = read(other)
    scene.points += 1.0
    write_parts(scene, other, 3)
    next(other.glob("part-0001*")).replace(next(folder.glob("part-0001*")))


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda folder: (folder / LIST).unlink(), f"it has no {LIST}"),
        (lambda folder: next(folder.glob("part-0002*")).unlink(), f"is missing: {LIST} lists it"),
        (lambda folder: next(folder.glob("cameras*")).unlink(), f"is missing: {LIST} lists it"),
        (lambda folder: next(folder.glob("part-0000*")).write_bytes(b"PK"), f"has 2 bytes, {LIST} says"),
        (flip_a_byte_of_a_part, "not a valid .npz archive"),
        (put_a_part_in_the_place_of_another, f"is not the file that {LIST} lists: its checksum differs"),
        (change_list(lambda listed: listed.update(sfmcpp_parts=2)), "of version 2, this version reads 1"),
        (change_list(lambda listed: listed.pop("sfmcpp_parts")), "is no list of parts"),
        (change_list(lambda listed: listed.pop("cameras")), "is no list of parts"),
        (change_list(lambda listed: listed["parts"].clear()), "it lists none"),
        (change_list(lambda listed: listed["parts"][0].update(name="../x")), "files beside it"),
        (change_list(lambda listed: listed["parts"][0].update(name="x" * 1000)), "file name too long"),
        (change_list(lambda listed: listed["parts"].pop()), "of the points"),
        (lambda folder: (folder / LIST).write_text("[" * 9999), "is no list of parts"),
    ],
)
def test_a_folder_that_is_not_whole_is_refused_by_name(
    tmp_path: Path, change: Callable[[Path], object], reason: str
) -> None:
    folder = a_folder(tmp_path)
    change(folder)
    assert reason in str(refusal(folder))


def test_more_parts_than_points_are_parts_without_points(tmp_path: Path) -> None:
    scene = circle_scene(4, 3, seed=1)
    write_parts(scene, tmp_path / "parts", 5)
    assert len(PartsFolder(tmp_path / "parts").entries) == 5
    assert_same_problem(read(tmp_path / "parts"), scene)


@PROPERTY
@given(st.integers(0, 2**32), st.integers(1, 9))
def test_own_bytes_of_all_ranks_are_the_file_and_rows_are_found_in_them(seed: int, count: int) -> None:
    """However many numbers a rank has, each row belongs to the one in whose bytes it begins."""
    rng = np.random.default_rng(seed)
    numbers = rng.integers(0, 10 ** rng.integers(1, 7), rng.integers(1, 60))
    text = "".join(f"{n}{rng.choice([' ', '  ', chr(10)])}" for n in numbers).strip()
    head, width = int(rng.integers(0, 4)), int(rng.integers(1, 5))
    rows = max(0, (len(numbers) - head) // width)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "x.txt"
        path.write_text(text)
        own = [read_own_bytes(path, rank, count) for rank in range(count)]
    assert b"".join(own) == text.encode()
    values = [np.array(data.split(), float) for data in own]
    found = []
    for rank in range(count):
        before = sum(len(v) for v in values[:rank])
        following = np.concatenate([np.empty(0), *(v[: width - 1] for v in values[rank + 1 :])])
        first, table = OwnNumbers(values[rank], before, following).rows(head, rows, width)
        assert not len(table) or first == sum(len(t) for t in found)
        found.append(table)
    expected = numbers[head : head + rows * width].reshape(-1, width)
    np.testing.assert_array_equal(np.concatenate(found), expected)


@pytest.mark.parametrize("count", [-1, 0, 65537, 2**70])
def test_no_files_and_more_than_a_folder_should_hold_are_refused(tmp_path: Path, count: int) -> None:
    folder, scene = tmp_path / "city.parts", circle_scene(4, 20, seed=1)
    with pytest.raises(InvalidArgument, match=f"parts = {count}: must be from 1 to 65536"):
        write_parts(scene, folder, count)
    assert not folder.exists()
    write_parts(scene, folder, 2)
    with pytest.raises(InvalidArgument, match="must be from 1 to 65536"):
        write_parts(scene, folder, count)
    assert read_parts(folder).num_points == 20


def test_nothing_but_its_name_or_its_list_makes_a_folder_one_of_parts(tmp_path: Path) -> None:
    scene: Problem = circle_scene(4, 20, seed=1)
    write_parts(scene, tmp_path / "elsewhere", 2)
    assert_same_problem(read(tmp_path / "elsewhere"), scene)
