"""Positions in EXIF as metres east, north and up, apart from the package that is measured."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

FloatArray = np.ndarray[Any, np.dtype[np.float64]]
# WGS84.
SEMI_MAJOR_M, FLATTENING = 6378137.0, 1 / 298.257223563
GPS = 0x8825


def local_positions(folder: Path, names: list[str]) -> dict[str, FloatArray]:
    """Metres (3,) east, north, up of the first one, of each photo whose EXIF tells a position."""
    found = {name: place for name in names if (place := _place(folder / name)) is not None}
    if not found:
        return {}
    latitude, longitude, _ = origin = next(iter(found.values()))
    north, east = np.deg2rad([latitude, longitude])
    axes = np.array(
        [
            [-np.sin(east), np.cos(east), 0],
            [-np.sin(north) * np.cos(east), -np.sin(north) * np.sin(east), np.cos(north)],
            [np.cos(north) * np.cos(east), np.cos(north) * np.sin(east), np.sin(north)],
        ]
    )
    start = _earth_centred(origin)
    return {name: axes @ (_earth_centred(place) - start) for name, place in found.items()}


def _place(path: Path) -> tuple[float, float, float] | None:
    """Latitude, longitude [deg] and height [m]."""
    from PIL import Image

    with Image.open(path) as image:
        tags = image.getexif().get_ifd(GPS)
    if not {1, 2, 3, 4} <= set(tags):
        return None
    latitude, longitude = (
        sum(float(part) / 60**k for k, part in enumerate(tags[number])) for number in (2, 4)
    )
    height = float(tags.get(6, 0.0)) * (-1 if tags.get(5) in (1, b"\x01") else 1)
    return latitude * (-1 if tags[1] == "S" else 1), longitude * (-1 if tags[3] == "W" else 1), height


def _earth_centred(place: tuple[float, float, float]) -> FloatArray:
    north, east = np.deg2rad(place[:2])
    flat = FLATTENING * (2 - FLATTENING)
    radius = SEMI_MAJOR_M / np.sqrt(1 - flat * np.sin(north) ** 2)
    out = (radius + place[2]) * np.cos(north)
    height = (radius * (1 - flat) + place[2]) * np.sin(north)
    return np.array([out * np.cos(east), out * np.sin(east), height])
