"""No small file asks for much memory: what it claims is compared with a limit before it is believed."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest

import sfmcpp
from sfmcpp import DatasetError, InvalidArgument
from sfmcpp.sources.io.files import MAX_EXPANDED, MAX_IMAGE
from sfmcpp.sources.vision import open_frames, open_photos


def png_of(width: int, height: int) -> bytes:
    """A black image; one that claims to be large ends early."""

    def chunk(kind: bytes, content: bytes) -> bytes:
        return (
            struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))
        )

    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    pixels = zlib.compress(bytes(min(height * (width + 1), 2_000_000)))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", pixels) + chunk(b"IEND", b"")


def test_images_of_more_pixels_than_any_sensor_has_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(png_of(32_000, 32_000))
    told = rf"a\.png: has 32000×32000 pixels, more than 160 million: refused; {MAX_IMAGE} allows more"
    with pytest.raises(DatasetError, match=told):
        next(iter(open_frames(tmp_path)))
    with pytest.raises(DatasetError, match=told.replace(r"a\.png: ", "")):
        open_photos(tmp_path)


def test_the_limit_of_pixels_can_be_changed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a.png").write_bytes(png_of(1_100, 1_000))
    monkeypatch.setenv(MAX_IMAGE, "1")
    with pytest.raises(DatasetError, match="1100×1000 pixels, more than 1 million"):
        next(iter(open_frames(tmp_path)))
    monkeypatch.setenv(MAX_IMAGE, "2")
    assert next(iter(open_frames(tmp_path))).shape == (1_000, 1_100)


@pytest.mark.parametrize("asked", ["much", "0", "-1", "1e3", "nan", "1" * 5_000])
def test_a_limit_that_is_none_is_told_in_place_of_a_fault_of_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, asked: str
) -> None:
    sfmcpp.write(sfmcpp.circle_scene(3, 10, seed=0), tmp_path / "a.npz")
    monkeypatch.setenv(MAX_EXPANDED, asked)
    with pytest.raises(InvalidArgument, match=f"^{MAX_EXPANDED} = '{asked[:18]}"):
        sfmcpp.read(tmp_path / "a.npz")


def test_metadata_ask_for_no_room_for_images_that_are_none(tmp_path: Path) -> None:
    problem = sfmcpp.circle_scene(3, 10, seed=0)
    problem.metadata.extra |= {
        "colmap_loose_image": np.array([300_000_000]),
        "colmap_loose_keypoint_index": np.array([0]),
        "colmap_loose_pixels": np.zeros((1, 2)),
    }
    with pytest.raises(DatasetError, match="metadata colmap_loose_image: must be from 0 to 2"):
        sfmcpp.write(problem, tmp_path / "model")


@pytest.mark.real
def test_hostile_archives_end_in_errors_of_the_file(data_dir: Path, tmp_path: Path) -> None:
    """What passes as a problem is refused by name, or written, by every format."""
    files = sorted((data_dir / "hostile").glob("*.npz"))
    assert files
    for file in files:
        refused = []
        for name in ("model", "a.out", "a.ply", "transforms.json", "a.txt", "a.npz"):
            try:
                sfmcpp.write(sfmcpp.read(file), tmp_path / name)
            except DatasetError as error:
                refused.append(str(error))
        assert refused, file.name
