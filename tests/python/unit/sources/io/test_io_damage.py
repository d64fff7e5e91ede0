"""Random damage to valid files of every format: a valid problem or one DatasetError, nothing else."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from io_helpers import PROPERTY, assert_valid, assert_valid_or_refused, mutated, no_warnings, random_problem
from sfmcpp import InvalidArgument, _core
from sfmcpp.sources.io import read, write

BAL_LIKE = {"f": 900, "k1": 0.2, "k2": 0.1}
TARGETS = [
    ("x.txt", "bal"),
    ("x.txt.gz", "bal"),
    ("x.txt.bz2", "bal"),
    ("x.txt.xz", "bal"),
    ("x.out", "bal"),
    ("x.npz", "perspective"),
    ("xcams.txt", "perspective"),
    ("xcams.txt", "calibrated"),
    ("colmap-text", "perspective"),
    ("colmap-binary", "perspective"),
]


@pytest.fixture(scope="module", params=TARGETS, ids=lambda target: "-".join(target))
def valid_files(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """Folder with the files of one small problem, and the name to read."""
    name, model = request.param
    folder = tmp_path_factory.mktemp("valid")
    problem = random_problem(11, model, BAL_LIKE if model != "calibrated" else {"f": 900}, least=3)
    problem.intrinsics[:] = problem.intrinsics[0]
    is_colmap = name.startswith("colmap")
    if is_colmap:
        (folder / name).mkdir()
    write(problem, folder / name, format=name if is_colmap else None)
    with no_warnings():
        assert_valid(read(folder / name))
    return folder, name


@settings(PROPERTY, max_examples=250)
@given(st.integers(0, 2**32))
def test_damaged_files_are_read_or_refused(valid_files: tuple[Path, str], seed: int) -> None:
    folder, name = valid_files
    with tempfile.TemporaryDirectory() as scratch:
        copy = Path(scratch) / "copy"
        shutil.copytree(folder, copy)
        files = sorted(path for path in copy.rglob("*") if path.is_file())
        victim = files[seed % len(files)]
        victim.write_bytes(mutated(victim.read_bytes(), seed))
        assert_valid_or_refused(copy / name)


def test_files_cut_anywhere_are_read_or_refused(valid_files: tuple[Path, str], tmp_path: Path) -> None:
    folder, name = valid_files
    shutil.copytree(folder, tmp_path / "copy")
    for path in sorted(path for path in (tmp_path / "copy").rglob("*") if path.is_file()):
        data = path.read_bytes()
        for size in np.unique(np.linspace(0, len(data) - 1, 60, dtype=int)):
            path.write_bytes(data[:size])
            assert_valid_or_refused(tmp_path / "copy" / name)
        path.write_bytes(data)


@pytest.mark.parametrize(
    ("head", "item", "reason"),
    [
        (7, 4, "head = 7: must be at least 8 bytes"),
        (8, 0, "item = 0: must be"),
        (8, -4, "item = -4: must be"),
    ],
)
def test_records_of_an_impossible_layout_are_refused(head: int, item: int, reason: str) -> None:
    with pytest.raises(InvalidArgument, match=reason):
        _core.split_records(bytes(24), 0, 2, head, item)
    with pytest.raises(InvalidArgument, match=reason):
        _core.join_records(np.zeros(24, np.uint8), np.zeros(0, np.uint8), head, item)
