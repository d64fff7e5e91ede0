"""All keyframes adjusted together at the end of a run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sfmcpp import InvalidArgument
from sfmcpp.geometry.similarity import fit_pose_similarity
from sfmcpp.slam import (
    FinalAdjustment,
    Gyroscope,
    Odometer,
    SlamResult,
    SlamSettings,
    TrackSequence,
    run_slam,
)
from winding import AT_CAMERA, Winding, winding


@pytest.fixture(scope="module")
def drive() -> Winding:
    return winding(seed=1)


def run(drive: Winding, how: str) -> SlamResult:
    sensors = [Odometer(drive.odometer), Gyroscope(drive.gyro, AT_CAMERA)]
    return run_slam(drive.sequence, SlamSettings(final_adjustment=how), sensors)


def test_it_lowers_the_error_and_the_cost_of_images_and_sensors(drive: Winding) -> None:
    off, auto = run(drive, "off"), run(drive, "auto")
    assert off.final is None
    assert auto.final is not None
    assert auto.final.kept
    assert set(auto.final.sensors) == {"odometer", "gyro"}
    for before, after in (auto.final.pixels, *auto.final.sensors.values()):
        assert after < before
    assert drive.errors(auto)[0] < drive.errors(off)[0]


def test_frames_between_keyframes_move_too(drive: Winding) -> None:
    off, on = run(drive, "off"), run(drive, "on")
    between = sorted(off.path.between)
    assert between == sorted(on.path.between)
    assert all(not np.array_equal(off.path.between[f], on.path.between[f]) for f in between)


def sliding(drive: Winding, seed: int) -> Winding:
    """A quarter of its tracks, which slide over what they show by half a pixel from frame to frame."""
    frames = list(drive.sequence)
    index = np.concatenate([np.full(len(frame.view.tracks), frame.number) for frame in frames])
    tracks = np.concatenate([frame.view.tracks for frame in frames])
    pixels = np.concatenate([frame.view.pixels for frame in frames])
    steps = np.random.default_rng(seed).normal(0, 0.5, (len(frames), tracks.max() + 1, 2))
    slid = pixels + np.cumsum(steps, axis=0)[index, tracks]
    few = tracks % 4 == 0
    times, camera = drive.sequence.t_s, drive.sequence.intrinsics
    return replace(drive, sequence=TrackSequence(times, index[few], tracks[few], slid[few], camera))


def error_m(drive: Winding, result: SlamResult) -> float:
    """Mean error of the centres, aligned by all."""
    frames = sorted(result.poses)
    found, true = np.stack([result.poses[frame] for frame in frames]), drive.truth[frames]
    apart = fit_pose_similarity(found, true).apply_to_poses(found)[:, :, 3] - true[:, :, 3]
    return float(np.linalg.norm(apart, axis=1).mean())


def test_images_whose_tracks_slide_yield_to_sensors() -> None:
    drives = [sliding(winding(0.3, seed), seed) for seed in (0, 1, 3)]
    ratios = [error_m(drive, run(drive, "auto")) / error_m(drive, run(drive, "off")) for drive in drives]
    # As if images were off by their noise alone: 0.93, 0.82 and 0.89.
    assert np.mean(ratios) < 0.7
    assert max(ratios) < 0.75


def test_it_is_kept_only_where_all_gain_unless_it_must_be() -> None:
    gain, loss = (2.0, 1.0), (1.0, 2.0)
    assert FinalAdjustment(True, gain, {"odometer": gain}).improved
    assert not FinalAdjustment(True, gain, {"odometer": gain, "gyro": loss}).improved
    assert not FinalAdjustment(True, loss, {"odometer": gain}).improved
    assert "not kept: cost of images 1 to 2" in FinalAdjustment(False, loss).describe()


def test_another_wish_is_refused() -> None:
    with pytest.raises(InvalidArgument, match="final_adjustment"):
        SlamSettings(final_adjustment="maybe")
