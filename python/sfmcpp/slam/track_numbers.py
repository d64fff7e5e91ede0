"""Numbers of tracks in a map, which takes memory for all points up to the largest number."""

from __future__ import annotations

from typing import Any

import numpy as np

from sfmcpp.model.frames import View

# A number that is farther above all before it does not become the track's number in the map, which has room
# for all points up to the largest.
_FARTHEST = 1_000_000


class TrackNumbers:
    """Gives tracks their numbers in the map: their own, or consecutive ones after a very large one came."""

    def __init__(self) -> None:
        self._own_end = 0
        # Consecutive numbers by tracks' own; None as long as no very large one has come.
        self._given: dict[int, int] | None = None

    def state(self) -> dict[str, Any]:
        """State gained from the frames so far, for checkpoints."""
        return {"own_end": self._own_end, "given": None if self._given is None else dict(self._given)}

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from a state."""
        self._own_end, self._given = state["own_end"], state["given"]

    def renumbered(self, view: View) -> View:
        """The view, whose tracks ascend, with the numbers of the map, ascending."""
        end = int(view.tracks[-1]) + 1 if len(view.tracks) else 0
        if self._given is None and end <= self._own_end + _FARTHEST:
            self._own_end = max(self._own_end, end)
            return View(view.tracks.astype(np.int32, copy=False), view.pixels, view.right)
        if self._given is None:
            self._given = {}
        numbers = np.array([self._number(track) for track in view.tracks.tolist()], dtype=np.int32)
        order = np.argsort(numbers)
        return View(numbers[order], view.pixels[order], view.right and view.right.only(order))

    def _number(self, track: int) -> int:
        assert self._given is not None
        if track < self._own_end:
            return track
        return self._given.setdefault(track, self._own_end + len(self._given))
