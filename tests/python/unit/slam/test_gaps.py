"""Where the map is lost from view, an odometer of velocities and a gyroscope lead the camera on."""

from __future__ import annotations

import numpy as np
import pytest

from sfmcpp.geometry.similarity import fit_pose_similarity
from sfmcpp.model import SensorStream
from sfmcpp.slam import Gyroscope, MotionSensor, Odometer, SlamResult, SlamSettings, TrackSequence, run_slam
from slam_helpers import INTRINSICS
from winding import AT_CAMERA, Winding, winding

GAP = range(50, 66)
LORRY = 40
ONCE = SlamSettings(hindsight=False)


def hidden(drive: Winding, lorry: int) -> TrackSequence:
    """The drive; in the frames of the gap only `lorry` tracks, which stand still in the image."""
    sequence = drive.sequence
    views = [sequence.view(frame) for frame in range(len(sequence))]
    rng = np.random.default_rng(1)
    first = 1 + max(int(view.tracks.max()) for view in views)
    at = rng.uniform([0.0, 0.0], 2 * INTRINSICS[2:4], (lorry, 2))
    tracks, pixels = [], []
    for frame, view in enumerate(views):
        # No track goes on across the gap.
        tracks.append(
            first + np.arange(lorry) if frame in GAP else view.tracks + (frame > GAP[0]) * 2 * first
        )
        pixels.append(at + rng.normal(0, 0.3, at.shape) if frame in GAP else view.pixels)
    frames = np.repeat(np.arange(len(views)), [len(seen) for seen in tracks])
    return TrackSequence(sequence.t_s, frames, np.concatenate(tracks), np.concatenate(pixels), INTRINSICS)


def sensors_of(drive: Winding) -> list[MotionSensor]:
    velocity = drive.odometer.values * [0.0, 0.0, 1.0]
    stream = SensorStream(drive.odometer.t_s, velocity, "velocity", "odometer")
    return [Odometer(stream, mounting=AT_CAMERA), Gyroscope(drive.gyro, AT_CAMERA)]


def error_in_gap(drive: Winding, result: SlamResult) -> float:
    """Largest error of the centres of the gap [m], aligned by the twenty frames before it."""
    frames = range(GAP[0] - 20, GAP[-1] + 1)
    found, true = np.stack([result.poses[frame] for frame in frames]), drive.truth[list(frames)]
    aligned = fit_pose_similarity(found[:20], true[:20]).apply_to_poses(found)
    return float(np.linalg.norm(aligned[20:, :, 3] - true[20:, :, 3], axis=1).max())


@pytest.mark.parametrize("lorry", [0, LORRY])
def test_sensors_lead_on_in_a_bend_whatever_hides_the_road(lorry: int) -> None:
    drive = winding(0.5)
    result = run_slam(hidden(drive, lorry), ONCE, sensors_of(drive))
    way_m = float(np.linalg.norm(np.diff(drive.truth[list(GAP), :, 3], axis=0), axis=1).sum())
    assert set(GAP) <= set(result.lost) | set(result.bridged)
    assert error_in_gap(drive, result) < 0.005 * way_m
