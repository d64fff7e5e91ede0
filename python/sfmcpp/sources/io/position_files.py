"""Positions of images to files: CSV, as :mod:`position_csv` reads it, and GeoJSON (RFC 7946)."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable
from os import PathLike
from pathlib import Path

from sfmcpp.errors import DatasetError
from sfmcpp.sources.io.atomic import atomic_files
from sfmcpp.sources.io.position_csv import NamedPositions


def write_positions(path: str | PathLike[str], named: NamedPositions) -> None:
    """Write positions of images, ``.csv`` or ``.geojson``.

    Parameters
    ----------
    path : path-like
        The file; its suffix tells the format.
    named : NamedPositions
        The positions; for GeoJSON, which knows no other frame, geodetic ones.

    Raises
    ------
    DatasetError
        If the suffix is another, the format cannot hold the positions, or the file cannot be written.
    """
    target = Path(path)
    require_positions_format(target, geodetic=named.geodetic)
    content = _WRITERS[target.suffix.lower()](named).encode()
    with atomic_files(target) as (file,):
        file.write(content)


def require_positions_format(path: Path, *, geodetic: bool) -> None:
    """Raise a DatasetError unless positions of this kind can be written to a file of this name."""
    if path.suffix.lower() not in _WRITERS:
        raise DatasetError(path, f"the name of a file of positions must end in {', '.join(_WRITERS)}")
    if path.suffix.lower() == _GEOJSON and not geodetic:
        raise DatasetError(path, "GeoJSON holds latitudes and longitudes: the positions are x, y, z")


def _csv(named: NamedPositions) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["name", *(("lat", "lon", "height") if named.geodetic else ("x", "y", "z"))])
    writer.writerows([name, *position] for name, position in named.positions.items())
    return text.getvalue()


def _geojson(named: NamedPositions) -> str:
    features = [
        {
            "type": "Feature",
            "geometry": {"type": "Point", "coordinates": [longitude, latitude, height]},
            "properties": {"name": name},
        }
        for name, (latitude, longitude, height) in named.positions.items()
    ]
    return json.dumps({"type": "FeatureCollection", "features": features}, indent=1) + "\n"


_GEOJSON = ".geojson"
_WRITERS: dict[str, Callable[[NamedPositions], str]] = {".csv": _csv, _GEOJSON: _geojson}
