"""A stage of a reconstruction that an interruption undoes: models are as they were before it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from sfmcpp.map import Map
from sfmcpp.model.arrays import BoolArray, FloatArray

_State = tuple[FloatArray, FloatArray, FloatArray, BoolArray, FloatArray]


@contextmanager
def undone_by_an_error(models: Sequence[Map]) -> Iterator[None]:
    """Give models the poses, points and intrinsics back that they had, where a stage ends in an exception.

    Which keypoints see which points must not be changed by the stage.

    Raises
    ------
    BaseException
        That of the stage; KeyboardInterrupt, for one.
    """
    before = [tuple(array.copy() for array in _state(world)) for world in models]
    try:
        yield
    except BaseException:
        for world, kept in zip(models, before, strict=True):
            for array, values in zip(_state(world), kept, strict=True):
                array[:] = values
        raise


def _state(world: Map) -> _State:
    return world.poses, world.points, world.intrinsics, world.fixed_intrinsics, world.point_errors
