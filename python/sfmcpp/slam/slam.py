"""The SLAM loop (thesis algorithm 10)."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp.errors import InvalidArgument
from sfmcpp.model import Gap
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import ANY, FloatArray
from sfmcpp.model.checks import require_finite, require_near
from sfmcpp.model.frames import Frame, View, checked_view, common
from sfmcpp.slam.between_keyframes import fit_between_keyframes, fit_latest_frame
from sfmcpp.slam.bridging import Follower, Step, rejoin, untied
from sfmcpp.slam.calibration import calibrate, calibrate_at_rest
from sfmcpp.slam.camera_check import warn_of_camera
from sfmcpp.slam.check_positions import check_positions
from sfmcpp.slam.checkpoints import State
from sfmcpp.slam.corrected_sensors import corrected_in_hindsight
from sfmcpp.slam.fusion import fuse
from sfmcpp.slam.gap_check import warn_of_gaps
from sfmcpp.slam.initialisation import Initialiser
from sfmcpp.slam.localisation import expected_rotation, locate
from sfmcpp.slam.mapping import adjust, finish_map, triangulate_new
from sfmcpp.slam.measurement import Measurement, MotionSensor
from sfmcpp.slam.metres_check import warn_of_metres
from sfmcpp.slam.odometer_clock import remember_step
from sfmcpp.slam.odometer_slip import check_odometers
from sfmcpp.slam.registration import place_at_end, place_in_world
from sfmcpp.slam.result import KeyframeRecord, SlamResult
from sfmcpp.slam.scale_drift import step_sigma, warn_of_scale
from sfmcpp.slam.sensor_faults import (
    faults_of_coverage,
    faults_of_epochs,
    faults_of_run,
    faults_of_streams,
    faults_so_far,
    has_wrong_axes,
)
from sfmcpp.slam.sensor_suite import SensorSuite
from sfmcpp.slam.settings import SlamSettings
from sfmcpp.slam.still_tracks import warn_of_still_tracks
from sfmcpp.slam.track_numbers import TrackNumbers
from sfmcpp.slam.world_map import WorldMap

# A larger aspect, fy / fx, is a focal length given in its place: no lens comes near it.
_LARGEST_ASPECT = 20.0
# Every so many keyframes the warnings are updated with the faults of the sensors so far.
_EVERY = 8


class Clock:
    """Milliseconds of each stage."""

    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, name: str) -> None:
        """Note what has passed since the last lap."""
        now = time.perf_counter()
        self.laps[name] = 1e3 * (now - self._last)
        self._last = now


class Slam:
    """One run over the frames of a camera; :meth:`step` takes one, :meth:`feed` what a sensor has measured.

    Parameters
    ----------
    intrinsics : (5,) or (12,) float64
        ``(f, aspect, cx, cy, skew)``; with distortion all of the model ``"perspective"``.
    settings : SlamSettings, optional
        What decides about keyframes, poses and points.
    sensors : sequence of MotionSensor
        What measures the motion beside the camera.

    Attributes
    ----------
    result : SlamResult
        The map and all poses so far: ``result.poses[number]`` is that of a frame, world_from_camera, which
        later frames may still correct.

    Raises
    ------
    InvalidArgument
        If `intrinsics` has another length, f or the aspect is not positive, the aspect is no ratio of focal
        lengths, or two sensors have the same name.
    """

    @checked(intrinsics=(ANY,))
    def __init__(
        self,
        intrinsics: ArrayLike,
        settings: SlamSettings | None = None,
        sensors: Sequence[MotionSensor] = (),
    ) -> None:
        self._intrinsics = np.asarray(intrinsics, np.float64)
        _require_intrinsics(self._intrinsics)
        self._finished = False
        self.settings = settings or SlamSettings()
        self._sensors = SensorSuite(sensors)
        self.result = SlamResult(warnings=faults_of_streams(self._sensors))
        # Looks for the start of a map, or of a new part of it; None while the camera is tracked.
        self._initialiser: Initialiser | None = self._new_initialiser()
        self._follower = Follower(self._intrinsics, self.settings, self._sensors)
        # The frames from the last keyframe on, and this one.
        self._lately: list[Frame] = []
        self._tracks = TrackNumbers()
        # Warnings of faults of sensors so far, which later ones replace.
        self._told: list[str] = []

    def state(self) -> State:
        """All that the next frames depend on; it changes with them."""
        start, sensors = self._initialiser and self._initialiser.state(), self._sensors.state()
        state = {"result": self.result, "lately": self._lately, "start": start, "sensors": sensors}
        return {**state, "tracks": self._tracks.state(), "told": list(self._told), "run": self._run()}

    def restore(self, state: State) -> None:
        """Go on from a state of a run over the same frames, with the same settings and sensors.

        Raises
        ------
        InvalidArgument
            If `state` is none, or of other intrinsics, settings or sensors, or sensors have measured less.
        """
        _require_same_run(state, self._run())
        self._tracks.restore(state["tracks"])
        self._told = state["told"]
        self.result, self._lately = state["result"], state["lately"]
        self._sensors.restore(state["sensors"])
        self._initialiser = None
        if state["start"] is not None:
            self._initialiser = self._new_initialiser()
            self._initialiser.restore(state["start"])

    def _run(self) -> dict[str, Any]:
        """What a run must have in common with one that goes on from its state."""
        return {
            "intrinsics": self._intrinsics.tolist(),
            "settings": asdict(self.settings),
            "sensors": self._sensors.ends_s(),
        }

    def _new_initialiser(self) -> Initialiser:
        return Initialiser(self._intrinsics, self.settings, self._sensors)

    def feed(self, name: str, t_s: ArrayLike, values: ArrayLike) -> None:
        """Take later measurements (n, k) of the sensor of that name, before the frames that they are for.

        Raises
        ------
        InvalidArgument
            If there is no such sensor, they break a rule of :class:`SensorStream`, or one comes more than a
            day after the one before.
        """
        self._sensors.feed(name, t_s, values)

    def step(self, frame: Frame) -> None:
        """Take the next frame.

        Raises
        ------
        InvalidArgument
            If its number or its time is not after that of the frame before, or more than a day, the run has
            been finished, a track is negative or there twice, or pixels have another shape or are not finite.
        """
        self._require_next(frame)
        frame = replace(frame, view=self._tracks.renumbered(checked_view(frame.view)))
        if not self.result.path.times:
            self.result.warnings += faults_of_epochs(self._sensors, frame.t_s)
        self.result.path.times[frame.number] = frame.t_s
        calibrate_at_rest(self.result, frame, self._sensors, self.settings)
        if self.result.world is None:
            self._start(frame)
            return
        clock = Clock()
        pose = self._locate(frame)
        clock.lap("resection")
        if pose is None:
            self._track_without_map(frame, clock)
            return
        self._initialiser = None
        if self.settings.trusts_declared:
            remember_step(self.result, self._lately[-1], frame, pose, self._sensors)
        self._note_pose(frame, pose)
        if self._is_keyframe(frame.view):
            self._add_keyframe(frame, pose, clock)
            return
        fitted = fit_latest_frame(self._world, frame.view, pose, self._measure(frame, pose), self.settings)
        self.result.path.settle(frame.number, fitted)

    def finish(self) -> None:
        """Finish after the last frame: adjust all keyframes, and report faults of the sensors."""
        self._finished = True
        self._tell([])
        calibrate_at_rest(self.result, None, self._sensors, self.settings)
        unscaled = place_at_end(self.result, self._sensors, self.settings)
        finish_map(self.result, self.settings)
        times = list(self.result.path.times.values())
        if self.result.world is not None:
            self.result.warnings += [*faults_of_coverage(self._sensors, times[0], times[-1]), *unscaled]
        if len(self.result.poses) > 1:
            if self.settings.trusts_declared:
                self._sensors.find_drifts()
            self.result.warnings += faults_of_run(self._sensors, self.result.seen_trajectory())
        self.result.warnings += check_positions(self.result, self._sensors)
        self.result.warnings += check_odometers(self.result, self._sensors, self.settings)
        self.result.warnings += warn_of_metres(self.result.world, self._sensors)
        self.result.warnings += warn_of_scale(self.result)
        self.result.warnings += warn_of_gaps(self.result, self._sensors)
        self.result.warnings += warn_of_still_tracks(self.result.world)
        self.result.warnings += warn_of_camera(self.result.world, self.settings)
        if self._judges_in_hindsight:
            self._sensors.refine_clocks(self.result.seen_trajectory())

    def in_hindsight(self) -> tuple[MotionSensor, ...] | None:
        """The sensors that a run over the same frames should have; None where these will do."""
        return corrected_in_hindsight(self._sensors) if self._judges_in_hindsight else None

    @property
    def _judges_in_hindsight(self) -> bool:
        return self.settings.trusts_declared and len(self.result.poses) > 1

    @property
    def has_wrong_mounting(self) -> bool:
        """Whether images contradict the mounting of an odometer, or the axes of a gyroscope."""
        return has_wrong_axes(self._sensors)

    def _require_next(self, frame: Frame) -> None:
        if self._finished:
            raise InvalidArgument(f"frame {frame.number}: comes after finish(): must come before it")
        times = self.result.path.times
        if not times:
            require_finite(f"frame {frame.number}: t_s", frame.t_s)
            return
        last = next(reversed(times))
        if frame.number <= last:
            raise InvalidArgument(f"frame.number = {frame.number}: must be above {last}, the last")
        if not frame.t_s > times[last]:
            rule = f"must be after {times[last]:.9g} s, that of {last}"
            raise InvalidArgument(f"frame {frame.number}: t_s = {frame.t_s:.9g} s, {rule}")
        require_near(f"frame {frame.number}: t_s", times[last], frame.t_s)

    def _start(self, frame: Frame) -> None:
        initialiser = self._initialiser
        assert initialiser is not None
        world = initialiser.try_frame(frame)
        if world is None:
            self.result.message = initialiser.reason
            return
        self.result.path.world, self.result.message = world, ""
        self._sensors.biases.begin()
        self._relocate(initialiser.frames, world)
        self._initialiser = None

    def _relocate(self, frames: Sequence[Frame], world: WorldMap) -> None:
        """Give poses to the frames from which a map has started."""
        keyframes = {keyframe.frame for keyframe in world.keyframes}
        for frame in frames:
            pose = None if frame.number in keyframes else self._locate(frame)
            if pose is None and frame.number not in keyframes:
                continue
            self._note_pose(frame, pose)
            self.result.trust(frame.number)

    def _locate(self, frame: Frame) -> FloatArray | None:
        rotation = expected_rotation(self._world, self._sensors, frame.t_s)
        found = locate(self._world, frame.view, self.settings, rotation)
        if found is not None and found.seen is not None:
            self.result.path.seen_from[frame.number] = found.pose[:, :3].T @ found.seen[:, :3]
        return None if found is None else found.pose

    def _note_pose(self, frame: Frame, pose: FloatArray | None) -> None:
        """Store the pose of a frame; None: it is a keyframe, whose pose is in the map."""
        between = self.result.path.between
        between.pop(frame.number, None)
        if pose is not None:
            between[frame.number] = pose
        self._lately = [seen for seen in self._lately if seen.number < frame.number] + [frame]

    def _track_without_map(self, frame: Frame, clock: Clock) -> None:
        """Track from frame to frame where too few points are left; initialise again once that fails."""
        result, last = self.result, self._lately[-1]
        step = self._follower.follow(frame, last, result)
        if step is None:
            result.lost.append(frame.number)
            pose = self._follower.predict(frame, result)
            self._initialiser = self._initialiser or self._new_initialiser()
        else:
            result.bridged.append(frame.number)
            pose = step.pose
        self._note_pose(frame, pose)
        if self._initialiser is not None:
            self._start_again(frame, self._initialiser)
        elif step is not None and step.moved:
            self._add_keyframes_of_gap(last, frame, step, clock)

    def _add_keyframes_of_gap(self, last: Frame, frame: Frame, step: Step, clock: Clock) -> None:
        """Keyframes on both sides of a gap, so that points come from what they share."""
        if self._world.keyframes[-1].frame != last.number:
            last = untied(last, self._world) if step.stood else last
            self._add_keyframe(last, self.result.path.pose_of(last.number), clock)
        self._add_keyframe(untied(frame, self._world) if step.stood else frame, step.pose, clock)

    def _start_again(self, frame: Frame, initialiser: Initialiser) -> None:
        """Start a new part of the map from the frames since the loss, if possible."""
        part = initialiser.try_frame(frame)
        if part is None:
            return
        rejoin(self.result, part, self._sensors, self._follower)
        self.result.restarts.append(initialiser.frames[0].number)
        self._relocate(initialiser.frames, self._world)
        self._initialiser = None

    def _is_keyframe(self, view: View) -> bool:
        world, settings = self._world, self.settings
        last = world.keyframes[-1].view
        here, there = common(view, last)
        if not len(here) or len(here) < settings.keyframe_overlap * len(last.tracks):
            return True
        known = np.count_nonzero(world.knows(view.tracks))
        moved = np.linalg.norm(view.pixels[here] - last.pixels[there], axis=1)
        return bool(known < settings.keyframe_min_tracks and np.median(moved) > settings.keyframe_parallax_px)

    def _add_keyframe(self, frame: Frame, pose: FloatArray, clock: Clock) -> None:
        world = self._world
        inliers = int(np.count_nonzero(world.knows(frame.view.tracks)))
        record = KeyframeRecord(frame.number, frame.t_s, inliers)
        if not (self.result.metric or world.stereo):
            record.step_sigma = step_sigma(world, frame.view, pose, self.settings)
        fused = fuse(world, frame.view, pose, self._measure(frame, pose), self.settings)
        world.add(frame, fused.pose, fused.constraints)
        self.result.path.between.pop(frame.number, None)
        self.result.path.seen_from.pop(frame.number, None)
        clock.lap("weights")
        record.new_points = triangulate_new(world, self.settings)
        clock.lap("triangulation")
        before = world.poses.copy()
        adjust(world, self.settings)
        self.result.path.follow(before)
        fit_between_keyframes(self.result, self._lately, self._sensors, self.settings)
        self._lately = [seen for seen in self._lately if seen.number >= frame.number]
        clock.lap("adjustment")
        place_in_world(self.result, self._sensors, self.settings)
        moved_back = frame.number in self.result.corrections[-1:]
        self._sensors.learn(fused, Gap(world.keyframes[-2].t_s, frame.t_s), moved_back=moved_back)
        calibrate(self.result, self._sensors, self.settings)
        if len(world.keyframes) % _EVERY == 0:
            self._tell(faults_so_far(self._sensors))
        record.take_fusion(fused)
        record.milliseconds = dict(clock.laps)
        self.result.record(record)

    def _tell(self, faults: list[str]) -> None:
        """Replace the warnings of faults of sensors that were given before."""
        self.result.warnings = [told for told in self.result.warnings if told not in self._told] + faults
        self._told = faults

    def _measure(self, frame: Frame, pose: FloatArray) -> list[Measurement]:
        return self._sensors.since(self._world.keyframes[-1], frame.t_s, pose, metric=self.result.metric)

    @property
    def _world(self) -> WorldMap:
        assert self.result.world is not None
        return self.result.world


def _require_same_run(state: object, run: dict[str, Any]) -> None:
    known = state.get("run") if isinstance(state, dict) else None
    if not isinstance(known, dict) or known.keys() != run.keys():
        raise InvalidArgument("state: must be what state() of a run has given")
    for what in ("intrinsics", "settings"):
        if known[what] != run[what]:
            raise InvalidArgument(f"state: is of a run with other {what}, must be the same")
    if list(known["sensors"]) != list(run["sensors"]):
        names = [", ".join(sensors) or "none" for sensors in (known["sensors"], run["sensors"])]
        raise InvalidArgument(
            f"state: is of a run with the sensors {names[0]}, must be those here: {names[1]}"
        )
    for name, end_s in known["sensors"].items():
        if run["sensors"][name] < end_s:
            told = f"sensor {name!r} ends at {run['sensors'][name]:.3f} s"
            raise InvalidArgument(f"state: {told}, must be fed what it had measured up to {end_s:.3f} s")


def _require_intrinsics(row: FloatArray) -> None:
    if len(row) not in (5, 12):
        raise InvalidArgument(f"intrinsics: {len(row)} numbers, must be 5, or 12 with distortion")
    f, aspect = row[:2].tolist()
    if not (f > 0 and 0 < aspect <= _LARGEST_ASPECT and np.isfinite(row).all()):
        rule = f"must be f, aspect, cx, cy, skew, with the aspect fy / fx at most {_LARGEST_ASPECT:g}"
        raise InvalidArgument(f"intrinsics: f = {f:g}, aspect = {aspect:g}: {rule}, f and aspect positive")
