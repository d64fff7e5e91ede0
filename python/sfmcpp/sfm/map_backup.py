"""Maps as they were before something that may fail or be interrupted."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sfmcpp.map import Map
from sfmcpp.model.arrays import BoolArray, FloatArray, IndexArray
from sfmcpp.model.metadata import WorldOrigin

_Unknowns = tuple[FloatArray, FloatArray, FloatArray, BoolArray, FloatArray]


@dataclass(frozen=True, eq=False)
class MapBackup:
    """Copy of what adjustments, the search for structure and georeferencing change in a map.

    Attributes
    ----------
    unknowns : tuple of array
        Poses, points, intrinsics, which of these are held, and errors of points.
    seen : (K,) int32
        Point that each keypoint sees, or -1.
    origin : WorldOrigin or None
        Where its world is.
    """

    unknowns: _Unknowns
    seen: IndexArray
    origin: WorldOrigin | None

    @classmethod
    def of(cls, world: Map) -> MapBackup:
        """Copy what there is of a map now."""
        poses, points, intrinsics, fixed, errors = (array.copy() for array in _unknowns(world))
        return cls((poses, points, intrinsics, fixed, errors), world.keypoint_points.copy(), world.origin)

    def restore(self, world: Map) -> None:
        """Make `world`, to which nothing was added since, what it was."""
        for array, values in zip(_unknowns(world), self.unknowns, strict=True):
            array[:] = values
        world.origin = self.origin
        changed: NDArray[np.intp] = np.flatnonzero(world.keypoint_points != self.seen)
        world.forget(changed[world.keypoint_points[changed] >= 0])
        back = changed[self.seen[changed] >= 0]
        world.observe(back, self.seen[back])


def _unknowns(world: Map) -> _Unknowns:
    return world.poses, world.points, world.intrinsics, world.fixed_intrinsics, world.point_errors


@contextmanager
def undone_by_an_error(models: Sequence[Map]) -> Iterator[None]:
    """Restore models where what is done in the context ends in an exception, Ctrl-C for one.

    Raises
    ------
    BaseException
        That exception.
    """
    before = [MapBackup.of(world) for world in models]
    try:
        yield
    except BaseException:
        for world, backup in zip(models, before, strict=True):
            backup.restore(world)
        raise
