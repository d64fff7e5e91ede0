"""Tracks that stand still in the image: a warning where the camera moves, none where it stands."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from sfmcpp.model.frames import View
from sfmcpp.slam.still_tracks import warn_of_still_tracks

BONNET = 6


def keyframes(moves_px: list[float]) -> Any:
    """A map of keyframes that see twenty tracks, of which four end at each, and a bonnet."""
    rng = np.random.default_rng(0)
    places, shift, views = rng.uniform(100, 500, (300, 2)), 0.0, []
    for k, move_px in enumerate(moves_px):
        shift += move_px
        scene = np.arange(4 * k, 4 * k + 20)
        pixels = places[scene] + [shift, 0.0]
        bonnet = np.column_stack([np.linspace(100, 500, BONNET), np.full(BONNET, 470.0)])
        tracks = np.concatenate([scene, 1000 + np.arange(BONNET)]).astype(np.int32)
        seen = np.concatenate([pixels, bonnet]) + rng.normal(0.0, 0.05, (len(tracks), 2))
        views.append(SimpleNamespace(view=View(tracks, seen)))
    return SimpleNamespace(keyframes=views)


def test_a_bonnet_is_a_warning_where_the_camera_moves() -> None:
    (told,) = warn_of_still_tracks(keyframes([5.0] * 17))
    assert told.startswith("tracks stand still in the image while the camera moves")


def test_a_camera_that_stands_between_keyframes_tells_of_none() -> None:
    """Its tracks end and others begin, which makes keyframes; all that last stand still."""
    assert warn_of_still_tracks(keyframes([0.0] * 33)) == []


def test_a_stand_does_not_hide_a_bonnet_seen_before_and_after_it() -> None:
    assert len(warn_of_still_tracks(keyframes([5.0] * 17 + [0.0] * 32 + [5.0] * 16))) == 1
