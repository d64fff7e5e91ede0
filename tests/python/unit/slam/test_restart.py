"""When all tracks end at once, a new part of the map begins, and takes its place after the old one."""

from __future__ import annotations

import numpy as np
import pytest

from sfmcpp.geometry.similarity import fit_pose_similarity
from sfmcpp.model import SensorStream
from sfmcpp.slam import MotionSensor, Odometer, SlamResult, TrackSequence, run_slam
from sfmcpp.sources.synthetic import corridor_scene
from slam_helpers import STEP_S

CUT = 25
SCENE = corridor_scene(50, 3000, length_m=25.0, pixel_sigma_px=0.3, seed=0)


def cut_sequence(blind: int = 0) -> TrackSequence:
    """The corridor, with new tracks from frame `CUT` on, and nothing seen in the `blind` frames before."""
    frame, track = SCENE.camera_index, SCENE.point_index
    seen = (frame < CUT - blind) | (frame >= CUT)
    track = np.where(frame >= CUT, track + SCENE.num_points, track)
    t_s = STEP_S * np.arange(SCENE.num_cameras)
    return TrackSequence(t_s, frame[seen], track[seen], SCENE.pixels[seen], SCENE.intrinsics[0])


def odometer() -> Odometer:
    steps = np.linalg.norm(np.diff(SCENE.centres, axis=0), axis=1)
    distances = np.append(0.0, np.cumsum(steps))
    return Odometer(SensorStream(STEP_S * np.arange(len(distances)), distances, "distance"))


def largest_error_m(result: SlamResult) -> float:
    frames = sorted(result.poses)
    found = np.stack([result.poses[k] for k in frames])
    similarity = fit_pose_similarity(found, SCENE.cameras[frames])
    return float(np.linalg.norm(similarity.apply(found[:, :, 3]) - SCENE.centres[frames], axis=1).max())


@pytest.mark.parametrize("sensors", [[], [odometer()]], ids=["alone", "odometer"])
def test_the_new_part_follows_the_old_one(sensors: list[MotionSensor]) -> None:
    result = run_slam(cut_sequence(), sensors=sensors)
    assert result.restarts == [CUT]
    assert sorted(result.poses) == list(range(SCENE.num_cameras))
    # The walk is even: going on at the same speed is right even without a sensor.
    assert largest_error_m(result) < 0.25


def test_an_odometer_tells_the_scale_of_the_new_part() -> None:
    result = run_slam(cut_sequence(blind=3), sensors=[odometer()])
    assert result.restarts == [CUT]
    assert result.lost == [CUT - 3, CUT - 2, CUT - 1]
    ahead = result.poses[SCENE.num_cameras - 1][:, 3] - result.poses[CUT][:, 3]
    true = SCENE.centres[-1] - SCENE.centres[CUT]
    assert np.linalg.norm(ahead) == pytest.approx(np.linalg.norm(true), rel=0.03)


def test_sensors_constrain_the_new_part_across_the_gap_too() -> None:
    result = run_slam(cut_sequence(blind=5), sensors=[odometer()])
    assert result.world is not None
    keyframes = result.world.keyframes
    first = next(k for k in range(len(keyframes)) if keyframes[k].frame >= CUT)
    (constraint,) = keyframes[first].constraints
    gap_m = np.linalg.norm(SCENE.centres[keyframes[first].frame] - SCENE.centres[keyframes[first - 1].frame])
    assert constraint.measurement.value == pytest.approx(gap_m, rel=0.02)
    found_m = np.linalg.norm(keyframes[first].pose[:, 3] - keyframes[first - 1].pose[:, 3])
    assert found_m == pytest.approx(gap_m, rel=0.03)


def test_both_parts_are_in_the_map() -> None:
    result = run_slam(cut_sequence())
    assert result.world is not None
    problem = result.world.whole_problem(min_views=2).problem
    assert problem.num_cameras == len(result.world.keyframes)
    known = np.flatnonzero(result.world.known)
    assert (known < SCENE.num_points).sum() > 100
    assert (known >= SCENE.num_points).sum() > 100


def test_without_a_cut_there_is_no_second_part() -> None:
    t_s = STEP_S * np.arange(SCENE.num_cameras)
    sequence = TrackSequence(t_s, SCENE.camera_index, SCENE.point_index, SCENE.pixels, SCENE.intrinsics[0])
    result = run_slam(sequence)
    assert result.restarts == []
    assert result.lost == []


def with_a_stop(
    pause: int = 60, life: int = 12, loose_px: float | None = None
) -> tuple[TrackSequence, np.ndarray]:
    """The corridor with a stop at `CUT`, in which tracks end as if hidden; what each frame sees it from.

    With `loose_px` one does not end, and is off by so much afterwards.
    """
    stations = np.r_[:CUT, np.full(pause, CUT), CUT : SCENE.num_cameras]
    rows = [np.flatnonzero(SCENE.camera_index == k) for k in stations]
    frame = np.repeat(np.arange(len(stations)), [len(some) for some in rows])
    chosen = np.concatenate(rows)
    point = SCENE.point_index[chosen]
    age = np.clip(frame, CUT, CUT + pause) + point % life
    track = point + SCENE.num_points * (age // life)
    noise = np.random.default_rng(0).normal(0, 0.5, (len(chosen), 2))
    if loose_px is not None:
        both = np.intersect1d(SCENE.point_index[rows[CUT - 4]], SCENE.point_index[rows[CUT + pause + 3]])
        track[point == both[0]] = both[0]
        noise[(point == both[0]) & (frame >= CUT + pause)] += loose_px
    t_s = STEP_S * np.arange(len(stations))
    return TrackSequence(t_s, frame, track, SCENE.pixels[chosen] + noise, SCENE.intrinsics[0]), stations


@pytest.mark.parametrize("loose_px", [None, -40.0])
def test_a_stop_in_which_all_tracks_end_keeps_the_scale(loose_px: float | None) -> None:
    """The speed so far is noise then: the usual depth tells how far the camera drives off.

    One track that did not end, and has come loose, does not decide on it.
    """
    sequence, stations = with_a_stop(loose_px=loose_px)
    result = run_slam(sequence)
    assert result.bridged
    centres = np.stack([result.poses[k][:, 3] for k in range(len(stations))])
    steps = np.linalg.norm(np.diff(centres, axis=0), axis=1)
    before, after = steps[5 : CUT - 1], steps[-CUT + 5 :]
    assert np.median(after) == pytest.approx(np.median(before), rel=0.15)
    assert np.linalg.norm(centres[CUT + 55] - centres[CUT]) < 0.1 * np.median(before)
