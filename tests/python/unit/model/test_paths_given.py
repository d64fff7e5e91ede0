"""What is no path is refused by every function that takes one; an empty text is not the working directory."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import sfmcpp
from sfmcpp import DatasetError, InvalidArgument
from sfmcpp.map import map_of_problem, read_map, write_map
from sfmcpp.sfm import match_graph_of_database
from sfmcpp.sources.cameras import read_intrinsics
from sfmcpp.sources.io import CheckpointFolder, read_control_points
from sfmcpp.sources.mounting_files import mounting_of
from sfmcpp.sources.vision import open_frames, open_photos
from sfmcpp.study.evaluation import read_image_poses

SCENE = sfmcpp.circle_scene(3, 10, seed=0)
CALLS: dict[str, Callable[[Any], Any]] = {
    "read": sfmcpp.read,
    "write": lambda path: sfmcpp.write(SCENE, path),
    "read_map": read_map,
    "write_map": lambda path: write_map(map_of_problem(SCENE), path),
    "checkpoints": CheckpointFolder,
    "control points": read_control_points,
    "database": match_graph_of_database,
    "frames": open_frames,
    "photos": open_photos,
    "poses": read_image_poses,
}


class BytesPath:
    """A path of bytes, which pathlib has none of."""

    def __fspath__(self) -> bytes:
        return b"model"


@pytest.mark.parametrize("call", CALLS.values(), ids=CALLS)
@pytest.mark.parametrize(
    "path", [b"model", BytesPath(), 3, None, ["model"]], ids=["bytes", "bytes path", "number", "none", "list"]
)
def test_what_is_no_path_is_refused(call: Callable[[Any], Any], path: object) -> None:
    with pytest.raises(InvalidArgument, match="must be a path"):
        call(path)


@pytest.mark.parametrize("call", CALLS.values(), ids=CALLS)
def test_an_empty_text_is_no_path(
    call: Callable[[Any], Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InvalidArgument, match="= '': must not be empty"):
        call("")
    assert not list(tmp_path.iterdir())


WITH_NUL = CALLS | {
    "camera": read_intrinsics,
    "checkpoints": lambda path: CheckpointFolder(path).begin(),
    "mounting": mounting_of,
}


@pytest.mark.parametrize("call", WITH_NUL.values(), ids=WITH_NUL)
def test_a_path_with_a_nul_is_refused(call: Callable[[Any], Any]) -> None:
    with pytest.raises(DatasetError):
        call(Path("a\0b.txt"))
