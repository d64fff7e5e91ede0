"""Texts as other systems save them: a mark before UTF-8, UTF-16, lines that end with CR."""

from __future__ import annotations

import codecs
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import sfmcpp
from sfmcpp.errors import DatasetError
from sfmcpp.sources.cameras import read_intrinsics
from sfmcpp.sources.io.image_tracks import read_image_tracks
from sfmcpp.sources.io.track_files import read_tracks
from sfmcpp.sources.io.trajectories import read_trajectory
from sfmcpp.sources.mounting_files import mounting_of

OTHERS: dict[str, tuple[str, Callable[[Path], object]]] = {
    "K.txt": ("700 0 600\n0 770 180\n0 0 1\n", read_intrinsics),
    "calib.txt": ("P0: 700 0 600 0 0 700 180 0 0 0 1 0\n", read_intrinsics),
    "kalibr.yaml": (
        "cam0:\n  camera_model: pinhole\n  intrinsics: [458.0, 457.0, 367.0, 248.0]\n",
        read_intrinsics,
    ),
    "tum.txt": ("# t x y z\n0 1 2 3 0 0 0 1\n1 2 3 4 0 0 0 1\n", lambda p: read_trajectory(p).poses),
    "tracks.csv": (
        "# sfmcpp tracks\n# intrinsics: f=700 cx=300 cy=200\nt_s,frame,track,u,v\n0,0,1,2,3\n0.1,1,,,\n",
        lambda p: read_tracks(p).pixels,
    ),
    "table.txt": ("image track x y\n0 0 1 2\n1 0 3 4\n", lambda p: read_image_tracks(p).pixels),
    "viff.xy": ("1 2 -1 -1\n3 4 5 6\n", lambda p: read_image_tracks(p).pixels),
    "mounting.txt": ("1 0 0 0\n0 1 0 0\n0 0 1 0\n", lambda p: mounting_of(p).camera_from_body),
}


def texts_of(target: Path) -> list[Path]:
    return [p for p in ([target] if target.is_file() else target.iterdir()) if p.suffix != ".bin"]


@pytest.mark.parametrize("name", ["a.txt", "a.out", "a.nvm", "a.g2o", "a.sfm", "sfm_data.json", "model"])
def test_models_are_read_behind_the_mark_and_refused_in_utf_16(tmp_path: Path, name: str) -> None:
    target = tmp_path / name
    scene = sfmcpp.circle_scene(4, 20, camera_model="bal", seed=1)
    sfmcpp.write(scene, target, format="colmap-text" if name == "model" else None)
    plain = sfmcpp.read(target)
    for text in texts_of(target):
        content = text.read_bytes()
        text.write_bytes(codecs.BOM_UTF8 + content)
        found = sfmcpp.read(target)
        np.testing.assert_array_equal(found.points, plain.points)
        np.testing.assert_array_equal(found.pixels, plain.pixels)
        if not name.endswith((".sfm", ".json")):  # in JSON the encoding is told by the text
            text.write_bytes(content.decode().encode("utf-16"))
            with pytest.raises(DatasetError, match="is text in UTF-16: must be UTF-8"):
                sfmcpp.read(target)
        text.write_bytes(content)


@pytest.mark.parametrize("name", OTHERS)
def test_other_texts_are_read_behind_the_mark(tmp_path: Path, name: str) -> None:
    content, read = OTHERS[name]
    path = tmp_path / name
    path.write_text(content)
    plain = read(path)
    path.write_bytes(codecs.BOM_UTF8 + content.encode())
    np.testing.assert_array_equal(np.asarray(read(path)), np.asarray(plain))


@pytest.mark.parametrize("end", [b"\r", b"\r\n"])
@pytest.mark.parametrize("name", ["a.txt", "acams.txt", "a.out", "a.nvm", "a.g2o", "model"])
def test_lines_of_models_may_end_otherwise(tmp_path: Path, name: str, end: bytes) -> None:
    target = tmp_path / name
    sfmcpp.write(
        sfmcpp.circle_scene(4, 20, camera_model="bal", seed=1),
        target,
        format="colmap-text" if name == "model" else None,
    )
    plain = sfmcpp.read(target)
    for text in texts_of(tmp_path if name == "acams.txt" else target):
        text.write_bytes(text.read_bytes().replace(b"\n", end))
    found = sfmcpp.read(target)
    np.testing.assert_array_equal(found.points, plain.points)
    np.testing.assert_array_equal(found.pixels, plain.pixels)


@pytest.mark.parametrize("end", [b"\r", b"\r\n"])
@pytest.mark.parametrize("name", OTHERS)
def test_lines_of_other_texts_may_end_otherwise(tmp_path: Path, name: str, end: bytes) -> None:
    content, read = OTHERS[name]
    path = tmp_path / name
    path.write_text(content)
    plain = read(path)
    path.write_bytes(content.encode().replace(b"\n", end))
    np.testing.assert_array_equal(np.asarray(read(path)), np.asarray(plain))
