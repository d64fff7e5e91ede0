"""Tracks that stand still in the image while the camera moves: a bonnet, a watermark, dirt on the lens.

A point of the world moves in the image with the camera, unless it is far away in the direction of the motion;
none of KITTI's drives has one that stands still over eight keyframes.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.frames import View, common
from sfmcpp.slam.world_map import WorldMap

# A track moved by less than this stands still [px], over so many keyframes.
_STILL_PX, _APART = 0.5, 8
# The camera moves where it moves half of the tracks by more than this from one keyframe to the next [px].
_MOVED_PX = 2.0
# A warning needs so many of them, in that share of the stretches.
_FEWEST, _STRETCHES = 5, 0.5
_REMEDY = "as a bonnet, a time stamp or dirt does: mask what is no part of the scene"


def still_among_changing(first: View, last: View, overlap: float) -> str:
    """Addition to the reason why a map does not start: tracks stand still while others change; or empty.

    Where the camera stands, at least the share `overlap` of the tracks is the same in both views.
    """
    pixels, moved_px = _common_pixels(first, last)
    is_still = moved_px < _STILL_PX
    still, count = np.count_nonzero(is_still), len(last.tracks)
    if still >= overlap * count or 2 * still < len(pixels):
        return ""
    return f": {still} of its {count} tracks stand still while the others change, {_REMEDY}"


def warn_of_still_tracks(world: WorldMap | None) -> list[str]:
    """Warn of tracks that stand still over stretches of keyframes in which the camera moves.

    Parameters
    ----------
    world : WorldMap or None
        The map at the end of a run.

    Returns
    -------
    list of str
        One warning, or none.
    """
    views = [] if world is None else [keyframe.view for keyframe in world.keyframes]
    found = []
    for first in range(0, len(views) - _APART, _APART):
        stretch = views[first : first + _APART + 1]
        if _camera_moves(stretch):
            pixels, moved_px = _common_pixels(stretch[0], stretch[-1])
            found.append(pixels[moved_px < _STILL_PX])
    stretches = [pixels for pixels in found if len(pixels)]
    if len(stretches) <= _STRETCHES * len(found) or sum(map(len, stretches)) < _FEWEST:
        return []
    places = np.concatenate(stretches)
    (left, top), (right, bottom) = places.min(axis=0), places.max(axis=0)
    where = f"at u = {left:.0f} to {right:.0f}, v = {top:.0f} to {bottom:.0f} px"
    return [f"tracks stand still in the image while the camera moves, {where}, {_REMEDY}"]


def _camera_moves(stretch: Sequence[View]) -> bool:
    """Whether it does anywhere: one that stands adds keyframes, too, as tracks end and others begin."""
    moved = (_common_pixels(before, after)[1] for before, after in pairwise(stretch))
    return any(len(moved_px) and np.median(moved_px) > _MOVED_PX for moved_px in moved)


def _common_pixels(before: View, after: View) -> tuple[FloatArray, FloatArray]:
    """Where the later view sees the tracks of both (n, 2), and by how much they have moved (n,) [px]."""
    in_before, in_after = common(before, after)
    pixels = after.pixels[in_after]
    return pixels, np.linalg.norm(pixels - before.pixels[in_before], axis=1)
