"""Where the origin of a problem's world is, once positions have told; it goes with the metadata."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arrays import FloatArray, finite_array
from sfmcpp.model.metadata import Metadata

_NAMES = {True: ("latitude_deg", "longitude_deg", "height_m"), False: ("x_m", "y_m", "z_m")}
_KEYS = {True: "origin_geodetic", False: "origin_xyz_m"}


@dataclass(frozen=True, eq=False)
class WorldOrigin:
    """Where a world in metres has its origin.

    Attributes
    ----------
    place : (3,) float64
        Latitude, longitude [deg, WGS84] and height [m], the axes of the world east, north, up; or x, y, z in
        a metric frame with the same axes [m].
    geodetic : bool
        Which of both.
    """

    place: FloatArray
    geodetic: bool

    @classmethod
    def of(cls, metadata: Metadata) -> WorldOrigin | None:
        """The origin that ``metadata.extra`` tells; None if it tells none."""
        for geodetic, key in _KEYS.items():
            if key in metadata.extra:
                return cls(finite_array(f"metadata {key}", metadata.extra[key], (3,)), geodetic)
        return None

    def put_into(self, metadata: Metadata) -> None:
        """Tell it in ``metadata.extra``, in place of any other."""
        for key in _KEYS.values():
            metadata.extra.pop(key, None)
        metadata.extra[_KEYS[self.geodetic]] = np.array(self.place, dtype=np.float64)

    def to_dict(self) -> dict[str, float]:
        """Its three numbers, by names with units."""
        return dict(zip(_NAMES[self.geodetic], np.asarray(self.place).tolist(), strict=True))

    @classmethod
    def from_dict(cls, told: dict[str, Any]) -> WorldOrigin:
        """:meth:`to_dict` backwards.

        Raises
        ------
        InvalidArgument
            If it is none, or not finite.
        """
        for geodetic, names in _NAMES.items():
            if set(told) == set(names):
                return cls(finite_array("origin", [told[name] for name in names], (3,)), geodetic)
        known = " or ".join(", ".join(names) for names in _NAMES.values())
        raise InvalidArgument(f"origin: has {', '.join(told) or 'nothing'}, must have {known}")
