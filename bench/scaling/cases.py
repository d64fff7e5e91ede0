"""The scenes whose size grows, and the files they are kept in."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

POOR_START = ("--point-sigma-m", "0.3", "--position-sigma-m", "0.3", "--rotation-sigma-deg", "1")
# What a collection has that a drive has not: focal lengths off by 5 %, and wrong matches.
PHOTOS_START = (*POOR_START, "--focal-sigma", "0.05", "--outliers", "0.05", "--outlier-sigma-px", "10")


@dataclass(frozen=True)
class Case:
    """A synthetic scene of one size.

    Attributes
    ----------
    name : str
        Stem of its file.
    shape : str
        Its rows are fitted together.
    cameras : int
        Their number.
    arguments : tuple of str
        Of `sfmcpp synth`.
    """

    name: str
    shape: str
    cameras: int
    arguments: tuple[str, ...]

    def path(self, folder: Path) -> Path:
        """Its file, written if it is not there."""
        target = folder / f"{self.name}.npz"
        if not target.exists():
            print(f"{self.name}: making the scene", flush=True)
            folder.mkdir(parents=True, exist_ok=True)
            command = [sys.executable, "-m", "sfmcpp", "synth", *self.arguments, "-o", str(target), "--quiet"]
            subprocess.run(command, check=True)
        return target


def scene_of(shape: str, stem: str, cameras: int, *more: str) -> Case:
    """A scene with the start of its shape."""
    start = PHOTOS_START if shape == "photo-collection" else POOR_START
    return Case(f"{stem}{cameras}", shape, cameras, (shape, "--cameras", str(cameras), *more, *start))


CASES: dict[str, Case] = {
    case.name: case
    for case in (
        *(scene_of("city-blocks", "city", count) for count in (1000, 3000, 10_000, 30_000, 100_000)),
        *(scene_of("photo-collection", "photos", count) for count in (600, 1000, 3000)),
        *(scene_of("drive-with-loops", "drive", count) for count in (1000, 3000, 10_000)),
        scene_of("corridor", "corridor", 600, "--points", "40000", "--camera-model", "bal"),
        scene_of("sphere", "sphere", 600, "--points", "24000", "--camera-model", "bal"),
    )
}
QUICK = ("city1000", "photos600", "drive1000")
