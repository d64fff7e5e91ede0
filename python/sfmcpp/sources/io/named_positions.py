"""Positions of images as tables have them: by name, or by what else tells whose they are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from sfmcpp.sources.io.position_columns import Triple

NamedBy = Literal["name", "index", "photo number", "order"]


@dataclass(frozen=True)
class NamedPositions:
    """Positions of images.

    Attributes
    ----------
    positions : dict
        Three numbers by name: latitude, longitude [deg, WGS84] and height [m], or x, y, z [m].
    geodetic : bool
        Which of both.
    sigmas : dict or None
        Standard deviations by name, east, north, up or along x, y, z [m].
    named_by : str
        What the names are: ``"name"``, those of images; ``"index"``, numbers of images from 0; ``"photo
        number"``, those that names of images end in; ``"order"``, from 0, of as many images as there are
        positions.
    unread : tuple of str
        Columns that seem to be standard deviations, where none were read.
    """

    positions: dict[str, Triple]
    geodetic: bool
    sigmas: dict[str, Triple] | None = None
    named_by: NamedBy = "name"
    unread: tuple[str, ...] = ()
