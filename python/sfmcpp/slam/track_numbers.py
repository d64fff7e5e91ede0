"""Numbers of tracks in a map, whose points take room up to the largest."""

from __future__ import annotations

from typing import Any

import numpy as np

from sfmcpp.model.frames import View

# A number may be so far above all before it: some tracks are seen by no keyframe, or come in no order.
_FARTHEST = 1_000_000


class TrackNumbers:
    """Gives tracks their numbers in the map: their own, and in order of their coming from a far one on."""

    def __init__(self) -> None:
        self._own_end = 0
        # Numbers from the end of the own ones on; None: there is no far track so far.
        self._given: dict[int, int] | None = None

    def state(self) -> dict[str, Any]:
        """State gained from the frames so far, for checkpoints."""
        return {"own_end": self._own_end, "given": None if self._given is None else dict(self._given)}

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from a state."""
        self._own_end, self._given = state["own_end"], state["given"]

    def renumbered(self, view: View) -> View:
        """The view with the numbers of the map, ascending."""
        end = int(view.tracks.max(initial=-1)) + 1
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
