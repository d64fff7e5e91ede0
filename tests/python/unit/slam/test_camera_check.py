"""Images of a map that contradict the focal length or the distortion that was given."""

from __future__ import annotations

import re

import numpy as np
import pytest

from sfmcpp.slam import SlamSettings, TrackSequence, WorldMap, run_slam
from sfmcpp.slam.camera_check import freed_intrinsics, warn_of_camera
from slam_helpers import INTRINSICS, path, small_map
from winding import beside, sequence_along, winding

F, CENTRE = INTRINSICS[0], INTRINSICS[2:4]


def seen_by(sequence: TrackSequence, given_f: float = F, k1: float = 0.0) -> TrackSequence:
    """The drive with a camera that is given with another focal length, or distorts without saying so."""
    views = [frame.view for frame in sequence]
    frames = np.repeat(np.arange(len(views)), [len(view.tracks) for view in views])
    tracks = np.concatenate([view.tracks for view in views])
    pixels = np.concatenate([view.pixels for view in views]) - CENTRE
    distorted = pixels * (1 + k1 * np.sum((pixels / F) ** 2, axis=1, keepdims=True)) + CENTRE
    return TrackSequence(sequence.t_s, frames, tracks, distorted, np.array([given_f, *INTRINSICS[1:]]))


def contradiction(sequence: TrackSequence) -> str:
    """The warning about the camera; empty without."""
    return "".join(text for text in run_slam(sequence).warnings if "contradict the camera" in text)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_right_camera_is_not_doubted(seed: int) -> None:
    assert contradiction(winding(seed=seed).sequence) == ""


@pytest.mark.parametrize("factor", [0.8, 1.25])
def test_a_wrong_focal_length_is_named_with_the_one_that_images_prefer(factor: float) -> None:
    text = contradiction(seen_by(winding().sequence, given_f=factor * F))
    told = re.search(r"focal length of ([\d.]+) ± ([\d.]+) px, \d+% (\w+) than ([\d.]+) px", text)
    assert told is not None
    preferred, sigma, given = (float(told[k]) for k in (1, 2, 4))
    assert abs(preferred - F) < 4 * sigma < 0.2 * F
    assert (told[3], given) == ("longer" if factor < 1 else "shorter", pytest.approx(factor * F))


@pytest.mark.parametrize("k1", [-0.25, 0.2])
def test_a_distortion_that_is_not_given_is_named(k1: float) -> None:
    text = contradiction(seen_by(winding().sequence, k1=k1))
    told = re.search(r"distortion k1 of (-?[\d.]+) ± ([\d.]+) to none", text)
    assert told is not None
    assert float(told[1]) == pytest.approx(k1, abs=0.05)


def test_a_straight_way_does_not_tell_the_focal_length() -> None:
    """Along it a longer scene seen by a longer lens looks the same."""
    way = path(np.linspace([0, 0, 0], [0, 0, 50], 100), np.zeros((100, 3)))
    sequence = seen_by(sequence_along(way, beside(way), sigma_px=0.5), given_f=1.3 * F)
    world = run_slam(sequence).world
    assert world is not None
    f = freed_intrinsics(world, SlamSettings())["f"]
    assert not f.contradicts
    assert f.sigma > 0.05 * F


def test_a_small_map_or_none_tells_nothing_and_a_map_stays_as_it_is() -> None:
    settings = SlamSettings(min_views=2)
    assert warn_of_camera(None, settings) == []
    assert warn_of_camera(WorldMap(INTRINSICS), settings) == []
    world = small_map([list(range(12))] * 6)
    before = world.poses.copy(), world.points.copy()
    assert freed_intrinsics(world, settings).keys() == {"f", "k1"}
    np.testing.assert_array_equal(world.poses, before[0])
    np.testing.assert_array_equal(world.points, before[1])
    assert freed_intrinsics(small_map([list(range(12))] * 3), settings) == {}
