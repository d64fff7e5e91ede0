"""Where the map is lost from view, an odometer of velocities leads the camera on, with a gyroscope or not."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sfmcpp.geometry.similarity import fit_pose_similarity
from sfmcpp.model import SensorStream
from sfmcpp.slam import Gyroscope, MotionSensor, Odometer, SlamResult, SlamSettings, TrackSequence, run_slam
from sfmcpp.slam.gap_check import UNSEEN
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


def of_short_tracks(drive: Winding, count: int) -> TrackSequence:
    """The drive; in the gap `count` tracks a frame, half of which go on to the next one, and none further."""
    sequence = drive.sequence
    views = [sequence.view(frame) for frame in range(len(sequence))]
    first = 1 + max(int(view.tracks.max()) for view in views)
    rows = [np.arange(count if frame in GAP else len(view.tracks)) for frame, view in enumerate(views)]
    tracks = [
        first * (2 + (frame + view.tracks[seen] % 2) // 2) + view.tracks[seen]
        if frame in GAP
        else view.tracks + (frame > GAP[0]) * first
        for (frame, view), seen in zip(enumerate(views), rows, strict=True)
    ]
    pixels = [view.pixels[seen] for view, seen in zip(views, rows, strict=True)]
    frames = np.repeat(np.arange(len(views)), [len(seen) for seen in tracks])
    return TrackSequence(sequence.t_s, frames, np.concatenate(tracks), np.concatenate(pixels), INTRINSICS)


def black(drive: Winding) -> TrackSequence:
    """The drive; in the gap nothing at all is seen."""
    return hidden(drive, 0)


@pytest.mark.parametrize(
    ("used", "kept", "untied"),
    [((), "turn and speed", "pose and scale"), ((0,), "turn", "pose"), ((1,), "speed", "place and scale")],
)
def test_what_no_sensor_measures_over_a_gap_is_told(used: tuple[int, ...], kept: str, untied: str) -> None:
    drive = winding(0.5)
    sensors = sensors_of(drive)
    warnings = run_slam(black(drive), ONCE, [sensors[k] for k in used]).warnings
    (told,) = [warning for warning in warnings if warning.startswith(UNSEEN)]
    first, last = GAP[0], GAP[-1]
    assert told.startswith(f"{UNSEEN} {first} to {last} (")
    assert f"kept its {kept}, and nothing else ties the {untied} of the map" in told


def test_a_gap_over_which_sensors_measure_all_is_not_told() -> None:
    drive = winding(0.5)
    warnings = run_slam(black(drive), ONCE, sensors_of(drive)).warnings
    assert not [warning for warning in warnings if warning.startswith(UNSEEN)]


@pytest.mark.parametrize(("used", "kept"), [((), "turn and speed"), ((0,), "turn"), ((1,), "speed")])
def test_what_no_sensor_measures_up_to_the_end_is_told(used: tuple[int, ...], kept: str) -> None:
    drive = winding(0.5)
    sequence, sensors = black(drive), sensors_of(drive)
    views = [sequence.view(frame) for frame in range(GAP[-1] + 1)]
    frames = np.repeat(np.arange(len(views)), [len(view.tracks) for view in views])
    tracks, pixels = (np.concatenate([getattr(v, name) for v in views]) for name in ("tracks", "pixels"))
    rows = (sequence.t_s[: len(views)], frames, tracks, pixels)
    warnings = run_slam(TrackSequence(*rows, INTRINSICS), ONCE, [sensors[k] for k in used]).warnings
    (told,) = [warning for warning in warnings if warning.startswith(UNSEEN)]
    assert told.startswith(f"{UNSEEN} {GAP[0]} to {GAP[-1]} (1.6 s)")
    assert told.endswith(f"kept its {kept}")


def test_poses_predicted_over_a_long_gap_are_rotations() -> None:
    """Their deviations from one trebled with every frame: after twenty the run ended with an error."""
    drive = winding(0.5)
    poses = run_slam(black(drive), ONCE).poses
    turns = np.stack([poses[frame][:, :3] for frame in GAP])
    np.testing.assert_allclose(
        turns @ turns.transpose(0, 2, 1), np.eye(3)[None].repeat(len(GAP), 0), atol=1e-12
    )


def turn_off(drive: Winding, result: SlamResult) -> float:
    """Error of the rotation from the first frame of the gap to the last [rad]."""
    found, true = (poses[GAP[0]][:, :3].T @ poses[GAP[-1]][:, :3] for poses in (result.poses, drive.truth))
    return float(Rotation.from_matrix(found.T @ true).magnitude())


def test_the_direction_of_an_odometer_holds_the_rotation_across_a_gap() -> None:
    drives = [winding(0.5, seed) for seed in range(3)]
    found = [run_slam(of_short_tracks(drive, 60), ONCE, sensors_of(drive)[:1]) for drive in drives]
    assert all(len(set(GAP) & set(result.bridged)) > len(GAP) / 2 for result in found)
    off = [turn_off(drive, result) for drive, result in zip(drives, found, strict=True)]
    assert np.sqrt(np.mean(np.square(off))) < 0.02, off
