"""A trajectory: poses of a camera over time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arrays import ANY, FloatArray, finite_array, require_increasing
from sfmcpp.model.checks import is_rotation


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Poses over time, world_from_camera.

    Parameters
    ----------
    t_s : (n,) float64
        Time stamps [s], strictly increasing; frame numbers where `stamped` is false.
    poses : (n, 3, 4) float64
        ``[R | c]``: rotation world_from_camera and centre in the world [m, unless up to scale].
    stamped : bool
        Whether `t_s` are times; some files hold poses alone.

    Raises
    ------
    InvalidArgument
        If a shape is wrong, there is no pose, a number is not finite, the stamps do not increase strictly, or
        the first three columns of a pose are no rotation.
    """

    t_s: FloatArray
    poses: FloatArray
    stamped: bool = True

    if TYPE_CHECKING:  # what is given need not be what is held

        def __init__(self, t_s: ArrayLike, poses: ArrayLike, stamped: bool = True) -> None: ...

    def __post_init__(self) -> None:
        object.__setattr__(self, "t_s", finite_array("t_s", self.t_s, (ANY,)))
        object.__setattr__(self, "poses", finite_array("poses", self.poses, (len(self.t_s), 3, 4)))
        if not len(self.t_s):
            raise InvalidArgument("poses: there are none, must be at least one")
        require_increasing("t_s", self.t_s)
        good = is_rotation(self.rotations)
        if not good.all():
            raise InvalidArgument(f"poses[{int(np.argmin(good))}]: its first three columns are no rotation")

    def __len__(self) -> int:
        return len(self.t_s)

    @property
    def rotations(self) -> FloatArray:
        """(n, 3, 3) view: rotations world_from_camera."""
        return self.poses[:, :, :3]

    @property
    def centres(self) -> FloatArray:
        """(n, 3) view: centres in the world."""
        return self.poses[:, :, 3]

    @property
    def length_m(self) -> float:
        """Sum of the distances between consecutive centres."""
        return float(np.linalg.norm(np.diff(self.centres, axis=0), axis=1).sum())

    def at(self, rows: NDArray[np.int64]) -> Trajectory:
        """The poses at `rows` (k,), which must increase."""
        return Trajectory(self.t_s[rows], self.poses[rows], self.stamped)

    def with_poses(self, poses: FloatArray) -> Trajectory:
        """Other poses (n, 3, 4) at the same times."""
        return Trajectory(self.t_s, poses, self.stamped)

    def __repr__(self) -> str:
        span = f"{self.t_s[0]:.3f} to {self.t_s[-1]:.3f} s" if self.stamped else "no times"
        return f"Trajectory({len(self)} poses, {span}, {self.length_m:.2f} m long)"
