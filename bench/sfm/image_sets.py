"""Sets of photos: where they are, what is given of their cameras, and what is known of the truth."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp")
TRUTHS = ("gt_dense_cameras", "truth", "sparse/0", "sparse", "poses.txt", "groundtruth.txt", "truth.txt")
MATRIX = "K.txt"
# What the sets by name are to us: everybody looked at them while thresholds were chosen.
DEVELOPMENT, HELD_OUT = "development", "held out"


@dataclass(frozen=True)
class ImageSet:
    """Photos to reconstruct.

    Attributes
    ----------
    name : str
        Name of files and rows.
    images : Path
        Folder of the photos.
    matrix : Path or None
        File of the 3×3 calibration matrix, which is then given and stays; None: the photos alone are given.
    truth : Path or None
        True poses, as `sfmcpp evaluate` reads them.
    gps : bool
        Whether EXIF holds positions to measure the centres against.
    role : str
        Whether thresholds of sfmcpp may have been chosen with an eye on this set. COLMAP runs with its
        defaults on every set.
    """

    name: str
    images: Path
    matrix: Path | None = None
    truth: Path | None = None
    gps: bool = False
    role: str = DEVELOPMENT

    @property
    def names(self) -> list[str]:
        """Names of the photos, those in folders below included."""
        found = (path for path in self.images.rglob("*") if path.suffix.lower() in IMAGE_SUFFIXES)
        return sorted(path.relative_to(self.images).as_posix() for path in found)

    def camera(self) -> list[list[float]] | None:
        """Rows of the calibration matrix, if one is given."""
        if self.matrix is None:
            return None
        numbers = [float(word) for word in self.matrix.read_text().replace(",", " ").split()]
        return [numbers[0:3], numbers[3:6], numbers[6:9]]


def known_sets() -> dict[str, ImageSet]:
    """Sets below ``$SFMCPP_DATA`` by name; those named …-auto without the calibration matrix."""
    data = Path(os.environ.get("SFMCPP_DATA", "."))
    strecha = [
        (name, data / name / "images", data / name / "gt_dense_cameras")
        for name in ("fountain_p11", "herz_jesus_p8")
    ]
    sets = [ImageSet(name, images, images / MATRIX, truth) for name, images, truth in strecha]
    sets += [ImageSet(f"{name}-auto", images, None, truth) for name, images, truth in strecha]
    sets.append(ImageSet("sceaux", data / "sceaux/images"))
    sets.append(ImageSet("kermit", data / "kermit"))
    sets.append(ImageSet("drone_beach", data / "drone_beach/images", gps=True))
    return {image_set.name: image_set for image_set in sets}


def set_of_folder(folder: Path, camera: str | None, truth: Path | None) -> ImageSet:
    """Any folder of photos, or with photos in ``images``; matrix and truth are looked for in it.

    Parameters
    ----------
    folder : Path
        The folder.
    camera : str, optional
        File of the calibration matrix, or ``"auto"`` for none. Default: ``K.txt`` beside the photos.
    truth : Path, optional
        True poses. Default: the first of `TRUTHS` in the folder.
    """
    images = folder / "images" if (folder / "images").is_dir() else folder
    found = next((folder / name for name in TRUTHS if (folder / name).exists()), None)
    matrix = next((place / MATRIX for place in (images, folder) if (place / MATRIX).is_file()), None)
    if camera is not None:
        matrix = None if camera == "auto" else Path(camera)
    name = folder.resolve().name + ("-auto" if camera == "auto" else "")
    return ImageSet(name, images, matrix, truth or found, role=HELD_OUT)
