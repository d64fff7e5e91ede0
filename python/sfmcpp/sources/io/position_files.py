"""Positions of images to files: CSV, as :mod:`position_csv` reads it, and GeoJSON (RFC 7946)."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path

from sfmcpp.errors import DatasetError
from sfmcpp.sources.io.atomic import atomic_files
from sfmcpp.sources.io.named_positions import NamedPositions
from sfmcpp.sources.io.position_columns import Triple


@dataclass(frozen=True)
class GivenPositions:
    """How positions that are written compare with those that were given.

    Attributes
    ----------
    residuals_m : mapping
        Distances by name, of images that had one [m].
    left_out : collection of str
        Names of those that were not used.
    offsets_m : mapping
        Written positions minus given ones along the axes, by name [m]; empty if they are not to be written.
    """

    residuals_m: Mapping[str, float] = field(default_factory=dict)
    left_out: Collection[str] = ()
    offsets_m: Mapping[str, Triple] = field(default_factory=dict)


def write_positions(
    path: str | PathLike[str], named: NamedPositions, given: GivenPositions | None = None
) -> None:
    """Write positions of images, ``.csv`` or ``.geojson``.

    Parameters
    ----------
    path : path-like
        The file; its suffix tells the format.
    named : NamedPositions
        The positions; for GeoJSON, which knows no other frame, geodetic ones. Standard deviations are written
        if all have them.
    given : GivenPositions, optional
        Columns, or properties, ``residual``, ``residual_e …`` or ``residual_x …``, and ``left_out`` tell of
        them.

    Raises
    ------
    DatasetError
        If the suffix is another, the format cannot hold the positions, or the file cannot be written.
    """
    target = Path(path)
    require_positions_format(target, geodetic=named.geodetic)
    content = _WRITERS[target.suffix.lower()](named, _facts(named, given))
    with atomic_files(target) as (file,):
        file.write(content.encode())


def require_positions_format(path: Path, *, geodetic: bool) -> None:
    """Raise a DatasetError unless positions of this kind can be written to a file of this name."""
    if path.suffix.lower() not in _WRITERS:
        raise DatasetError(path, f"the name of a file of positions must end in {', '.join(_WRITERS)}")
    if path.suffix.lower() == _GEOJSON and not geodetic:
        raise DatasetError(path, "GeoJSON holds latitudes and longitudes: the positions are x, y, z")


Facts = dict[str, dict[str, float | bool | None]]


def _facts(named: NamedPositions, given: GivenPositions | None) -> Facts:
    """Facts of each position, by its name and then by the name of the fact."""
    facts: Facts = {name: {} for name in named.positions}
    axes = "enu" if named.geodetic else "xyz"
    sigmas = named.sigmas or {}
    for name, known in facts.items():
        if facts.keys() <= sigmas.keys():
            known |= {f"sigma_{axis}": sigma for axis, sigma in zip(axes, sigmas[name], strict=True)}
        if given is not None:
            known["residual"] = given.residuals_m.get(name)
            if given.offsets_m:
                along = given.offsets_m.get(name, (None,) * 3)
                known |= {f"residual_{axis}": offset for axis, offset in zip(axes, along, strict=True)}
            known["left_out"] = name in given.left_out
    return facts


def _csv(named: NamedPositions, facts: Facts) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    titles = list(next(iter(facts.values()), {}))
    writer.writerow(["name", *(("lat", "lon", "height") if named.geodetic else ("x", "y", "z")), *titles])
    quoting = csv.writer(text, lineterminator="\n", quoting=csv.QUOTE_NONNUMERIC)
    for name, position in named.positions.items():
        # Between quotes, a name that begins as comments do is none.
        chosen = quoting if name.startswith("#") else writer
        chosen.writerow([name, *position, *map(_cell, facts[name].values())])
    return text.getvalue()


def _cell(value: float | bool | None) -> float | int | str:
    """A flag is 0 or 1, what is unknown empty."""
    return "" if value is None else int(value) if isinstance(value, bool) else value


def _geojson(named: NamedPositions, facts: Facts) -> str:
    features = [
        {
            "type": "Feature",
            "geometry": {"type": "Point", "coordinates": [longitude, latitude, height]},
            "properties": {"name": name, **facts[name]},
        }
        for name, (latitude, longitude, height) in named.positions.items()
    ]
    return json.dumps({"type": "FeatureCollection", "features": features}, indent=1) + "\n"


_GEOJSON = ".geojson"
_WRITERS: dict[str, Callable[[NamedPositions, Facts], str]] = {".csv": _csv, _GEOJSON: _geojson}
POSITION_SUFFIXES = tuple(_WRITERS)
