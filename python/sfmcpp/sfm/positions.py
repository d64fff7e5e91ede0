"""Positions of images in metres from a near origin, from whatever tells them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.sensors.gps import east_north_up, require_metres
from sfmcpp.sfm.position_names import named_alike

# Origins of metric frames are whole multiples of this: what lies nearer to zero stays as it is [m].
_GRID_M = 1000.0
# A position at zero is none where the others are farther from there than any flight goes [m].
_FAR_M = 100e3


@dataclass(frozen=True, eq=False)
class Positions:
    """Positions of images in a metric frame.

    Attributes
    ----------
    metres : (I, 3) float64
        East, north, up of the origin, or along the axes of the user's frame [m]; not a number where unknown.
    origin : (3,) float64
        Latitude, longitude [deg, WGS84] and height [m] of the origin, or its x, y, z in the user's frame [m].
    geodetic : bool
        Which of both.
    sigmas_m : (I, 3) float64 or None
        Standard deviations along the axes, as stated [m].
    no_fix : (I,) bool or None
        Which of the unknown ones a receiver without a fix has put at zero.
    """

    metres: FloatArray
    origin: FloatArray = field(default_factory=lambda: np.zeros(3))
    geodetic: bool = False
    sigmas_m: FloatArray | None = None
    no_fix: BoolArray | None = None

    @property
    def known(self) -> BoolArray:
        """(I,) which images have a position."""
        return np.asarray(np.isfinite(self.metres[:, 0]))

    @property
    def stated_sigma_m(self) -> float | None:
        """The median stated standard deviation of a coordinate [m]; None if none is."""
        return None if self.sigmas_m is None else float(np.median(self.sigmas_m[self.known]))

    @property
    def member_weights(self) -> FloatArray:
        """(I, 3) weights of the coordinates beside one of the median standard deviation."""
        if self.sigmas_m is None or self.stated_sigma_m is None:
            return np.ones(self.metres.shape)
        return np.asarray((self.stated_sigma_m / self.sigmas_m) ** 2)

    def of(self, images: NDArray[np.intp] | BoolArray) -> Positions:
        """The positions of some of the images."""
        sigmas = None if self.sigmas_m is None else self.sigmas_m[images]
        no_fix = None if self.no_fix is None else self.no_fix[images]
        return replace(self, metres=self.metres[images], sigmas_m=sigmas, no_fix=no_fix)


def local_positions(rows: FloatArray, geodetic: bool, sigmas_m: FloatArray | None = None) -> Positions:
    """Take positions of images over into a metric frame whose origin is near them.

    Parameters
    ----------
    rows : (I, 3) float64
        Latitude, longitude [deg, WGS84] and height [m], or x, y, z [m]; not a number where unknown.
    geodetic : bool
        Which of both.
    sigmas_m : (I, 3) float64, optional
        Stated standard deviations; positive where positions are known.

    Returns
    -------
    Positions
        Geodetic ones in the tangent plane of their median, others from an origin on whole kilometres, as
        coordinates of millions of metres would cost digits. Positions at zero, far from the others, are
        unknown.

    Raises
    ------
    InvalidArgument
        If no position is known, a latitude is out of range, x and y look like degrees, or a standard
        deviation is not positive.
    """
    told = np.isfinite(rows).all(axis=1)
    if not told.any():
        raise InvalidArgument("gps: no position is known")
    if not geodetic:
        require_metres(rows[told])
    if sigmas_m is not None:
        wrong = told & ~((sigmas_m > 0) & np.isfinite(sigmas_m)).all(axis=1)
        if wrong.any():
            row = int(np.argmax(wrong))
            raise InvalidArgument(f"sigmas_m[{row}] = {sigmas_m[row]}: must be positive and finite")
    middle = np.asarray(np.median(rows[told], axis=0))
    metres = np.full(rows.shape, np.nan)
    origin = middle if geodetic else np.trunc(middle / _GRID_M) * _GRID_M
    metres[told] = east_north_up(rows[told], origin) if geodetic else rows[told] - origin
    lost = ~rows[:, :2].any(axis=1) & (np.linalg.norm(metres, axis=1) > _FAR_M)
    metres[lost] = np.nan
    return Positions(metres, origin, geodetic, sigmas_m, lost)


def positions_of(
    names: list[str],
    known: Mapping[str, tuple[float, float, float]],
    *,
    geodetic: bool,
    sigmas: Mapping[str, tuple[float, float, float]] | None = None,
) -> Positions:
    """Put positions of images in the order of the images.

    Parameters
    ----------
    names : list of I str
        Names of images.
    known : mapping
        Positions by name, see :func:`named_alike`; names that are no image's are left alone.
    geodetic : bool
        Whether they are latitude, longitude [deg, WGS84] and height [m]; else x, y, z [m].
    sigmas : mapping, optional
        Stated standard deviations along the axes by name [m].

    Returns
    -------
    Positions
        See :func:`local_positions`.

    Raises
    ------
    InvalidArgument
        If no name is an image's, one may be that of several, or a latitude is out of range.
    """
    alike = named_alike(names, known)
    if not alike:
        listed, wanted = (", ".join(list(some)[:3]) for some in (known, names))
        raise InvalidArgument(f"gps: none of its names ({listed}) is the name of an image ({wanted})")
    told = [alike.get(name) for name in names]
    stated = None if sigmas is None else _in_order(told, sigmas)
    return local_positions(_in_order(told, known), geodetic, stated)


def _in_order(told: list[str | None], known: Mapping[str, tuple[float, float, float]]) -> FloatArray:
    return np.array([(np.nan,) * 3 if name is None else known[name] for name in told]).reshape(-1, 3)
