"""Frames of a robot that do not move, as ``/tf_static`` joins them."""

from __future__ import annotations

from typing import Any

import numpy as np

from sfmcpp.geometry.so3 import rotation_from_quaternion
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.rigs import composed, relative
from sfmcpp.sources.bags.messages import Unusable


class StaticFrames:
    """A forest of frames: each has a pose in its parent."""

    def __init__(self) -> None:
        self._parents: dict[str, tuple[str, FloatArray]] = {}

    def add(self, message: Any) -> None:
        """Take the transforms of a message; later ones of a frame replace earlier ones.

        Raises
        ------
        Unusable
            If one is no pose.
        """
        for item in message.transforms:
            parent, child = (name.lstrip("/") for name in (item.header.frame_id, item.child_frame_id))
            turn, shift = item.transform.rotation, item.transform.translation
            quaternion = np.array([[turn.w, turn.x, turn.y, turn.z]], dtype=np.float64)
            centre = np.array([shift.x, shift.y, shift.z], dtype=np.float64)
            if not (np.isfinite(quaternion).all() and quaternion.any() and np.isfinite(centre).all()):
                raise Unusable(f"the transform of {child!r} is no pose")
            self._parents[child] = parent, np.column_stack([rotation_from_quaternion(quaternion)[0], centre])

    def pose(self, outer: str, inner: str) -> FloatArray | None:
        """Pose (3, 4) outer_from_inner; None where the two are not joined, or one has no name."""
        if not (outer and inner):
            return None
        if outer == inner:
            return np.eye(3, 4)
        ways = [self._way_up(name) for name in (outer, inner)]
        common = next((name for name in ways[1] if name in ways[0]), None)
        if common is None:
            return None
        from_outer, from_inner = (way[common] for way in ways)
        return np.asarray(relative(from_outer[None], from_inner[None])[0])

    def _way_up(self, name: str) -> dict[str, FloatArray]:
        """Poses ancestor_from_frame of all ancestors, the frame itself first."""
        found = {name: np.eye(3, 4)}
        while name in self._parents:
            parent, pose = self._parents[name]
            if parent in found:  # a loop
                break
            found[parent] = composed(pose[None], found[name][None])[0]
            name = parent
        return found
