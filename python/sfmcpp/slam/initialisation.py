"""Initialisation of a map, or of a new part of it, from three keyframes (thesis §3.3.2).

Relative pose, triangulation, resection, adjustment.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from sfmcpp.geometry import RelativePose, relative_pose, relative_pose_of_rotation, so3
from sfmcpp.geometry.relative_pose import denying_pose
from sfmcpp.model import ConstraintGroup, Problem
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.frames import Frame, common
from sfmcpp.slam.calibration import remove_biases
from sfmcpp.slam.fusion import constraint_groups, presumed_weights
from sfmcpp.slam.localisation import RANSAC_ITERATIONS, SAME_TURN_RAD, expected_rotation, locate
from sfmcpp.slam.mapping import LOCAL_LOSS, drop_outliers, triangulate_new
from sfmcpp.slam.measurement import Measurement
from sfmcpp.slam.sensor_suite import SensorSuite
from sfmcpp.slam.settings import SlamSettings
from sfmcpp.slam.still_tracks import still_among_changing
from sfmcpp.slam.world_map import Keyframe, WorldMap
from sfmcpp.weighting import solve

# With fewer shared tracks than this many times `min_inliers`, half of the usual parallax has to do.
_RUNNING_OUT = 3
# Images support a gyroscope's rotation if its pose has this share of the inliers of their best pose …
_SUPPORT = 0.85
# … and this share of the matches.
_LEAST_SHARE = 0.7
# A start that contradicts the gyroscope is refused so many times, then accepted: the sensor may be wrong.
_DOUBTS = 3
# A bias is estimated from so many of the frames so far, evenly spread, or up to twice as many.
_FRAMES_FOR_BIAS = 8
# Beyond so many of its standard deviations a gyroscope does not constrain a rotation of the start.
_SAME_TURN_SIGMAS = 4.0
# Points that one pair of left and right images must give to start a map by itself; some will be wrong.
_FEWEST_OF_A_PAIR = 30
# Images contradict rotations that raise their cost by so many standard deviations per degree of freedom.
# Fault-free gyroscopes came to 4, as the error of a track lasts; a clock off by half a second came to 10
# where it turned the start by degrees.
_DENIED_SIGMAS = 5.0
# Their noise is at least this: with the exact tracks of a simulation any rotation raises the cost [px].
_LEAST_NOISE_PX = 0.1
# Degrees of freedom of three cameras up to a similarity: 18 − 7.
_FREEDOM_OF_CAMERAS = 11
# Parallax that a rotation leaves is no noise from here on; where a camera only turns it is a tenth [px].
_LEFT_BY_ROTATION_PX = 2.0
# So many times the parallax of other starts; a few matches of a car that turns come to 2.5 times.
_LONG_WAY = 4.0
# Where frames may deny a start, from its first frame on: the nearer to it, the less parallax, but the more of
# a plane that the last frame has lost is in them.
_BETWEEN = (1 / 2, 3 / 8, 1 / 4)
# Frames kept while the camera stands still: beyond, the oldest are dropped.
_MOST_FRAMES = 1000


class Initialiser:
    """Looks for a frame that, with the first one, fixes the scene up to scale; or with its own right image.

    Parameters
    ----------
    intrinsics : (5,) or (12,) float64
        Of the camera.
    settings : SlamSettings
        Thresholds and seed.
    sensors : SensorSuite, optional
        A gyroscope among them tells the rotations, where the images support it.

    Attributes
    ----------
    frames : list of Frame
        Those offered, from the one that would be the first keyframe.
    reason : str
        Why there is no map yet.
    """

    def __init__(
        self, intrinsics: FloatArray, settings: SlamSettings, sensors: SensorSuite | None = None
    ) -> None:
        self._intrinsics, self._settings, self._sensors = intrinsics, settings, sensors or SensorSuite()
        self.frames: list[Frame] = []
        self.reason = "no frame yet"
        self._contradictions = 0

    def state(self) -> dict[str, Any]:
        """State gained from the frames so far, for checkpoints."""
        return {"frames": self.frames, "reason": self.reason, "contradictions": self._contradictions}

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from a state."""
        self.frames, self.reason = state["frames"], state["reason"]
        self._contradictions = state["contradictions"]

    def try_frame(self, frame: Frame) -> WorldMap | None:
        """Offer the next frame; the map of the first three keyframes once there is one."""
        self.frames = [*self.frames[-_MOST_FRAMES:], frame]
        if frame.view.right is not None and (world := self._map_of_pair(frame)) is not None:
            return world
        if len(self.frames) == 1:
            self.reason = f"frame {frame.number} is the only frame so far"
            return None
        first = self.frames[0]
        in_first, in_last = common(first.view, frame.view)
        if len(in_first) < 2 * self._settings.min_inliers:
            self.reason = f"frames {first.number} and {frame.number} share only {len(in_first)} tracks"
            self.frames = [frame]
            return None
        before, after = first.view.pixels[in_first], frame.view.pixels[in_last]
        moved_px = np.median(np.linalg.norm(after - before, axis=1))
        if len(self.frames) < 3 or moved_px < self._parallax_px(len(in_first)):
            self.reason = f"the image moves {moved_px:.3g} px from frame {first.number} to {frame.number}"
            self.reason += still_among_changing(first.view, frame.view, self._settings.keyframe_overlap)
            return None
        return self._map_of(before, after)

    def _map_of_pair(self, frame: Frame) -> WorldMap | None:
        """The map of a left and a right image, if they give enough points: one keyframe, in metres."""
        world = self._map([(frame, np.eye(3, 4))])
        world.metric = True
        return world if triangulate_new(world, self._settings) >= _FEWEST_OF_A_PAIR else None

    def _parallax_px(self, shared: int) -> float:
        """Parallax to wait for: half of it will do once tracks run out, before there are none left."""
        return (0.5 if self._runs_out(shared) else 1.0) * self._settings.start_parallax_px

    def _runs_out(self, shared: int) -> bool:
        """Whether soon too few tracks will be left, and a pose from them may be a wrong one."""
        return shared < _RUNNING_OUT * self._settings.min_inliers

    def _map_of(self, before: FloatArray, after: FloatArray) -> WorldMap | None:
        first, last = self.frames[0], self.frames[-1]
        at_last = self._pose_of_last(before, after)
        if at_last is None:
            return None
        middle = self.frames[(len(self.frames) - 1) // 2]
        pair = self._pair(last, at_last)
        at_middle = self._located(pair, middle)
        if at_middle is None:
            return None
        if (denying := self._denied_between(pair)) is not None:
            middle, at_middle = denying
            pair = self._pair(middle, at_middle)
            at_last = self._located(pair, last)
            if at_last is None:
                return None
        world = self._map([(first, np.eye(3, 4)), (middle, at_middle), (last, at_last)])
        tracks = np.flatnonzero(pair.known)
        world.points[tracks] = pair.points[tracks]
        self._constrain(world)
        return world if self._adjusted(world) else None

    def _pair(self, frame: Frame, pose: FloatArray) -> WorldMap:
        """Map of the first frame and another one at `pose` (3, 4)."""
        world = self._map([(self.frames[0], np.eye(3, 4)), (frame, pose)])
        triangulate_new(world, self._settings)
        return world

    def _located(self, pair: WorldMap, frame: Frame) -> FloatArray | None:
        """Pose (3, 4) of a frame in the map of two others; None if it has none."""
        rotation = expected_rotation(pair, self._sensors, frame.t_s)
        located = locate(pair, frame.view, self._settings, rotation)
        if located is None:
            self.reason = f"frame {frame.number} beside the first keyframes has no pose"
            return None
        return located.pose

    def _denied_between(self, pair: WorldMap) -> tuple[Frame, FloatArray] | None:
        """A frame between those of a pair that denies its pose there, and the pose (3, 4) that it has."""
        for part in _BETWEEN:
            frame = self.frames[int((len(self.frames) - 1) * part)]
            pose = self._located(pair, frame)
            if pose is not None and (denying := self._denying_pose(frame, pose)) is not None:
                return frame, denying
        return None

    def _denying_pose(self, frame: Frame, pose: FloatArray) -> FloatArray | None:
        """Another pose (3, 4) of a frame whose matches with the first one rule `pose` out; None of others."""
        in_first, in_frame = common(self.frames[0].view, frame.view)
        pixels = self.frames[0].view.pixels[in_first], frame.view.pixels[in_frame]
        return denying_pose(
            *pixels,
            self._intrinsics,
            pose,
            min_parallax_px=_LEFT_BY_ROTATION_PX,
            max_iterations=RANSAC_ITERATIONS,
            seed=self._settings.seed,
        )

    def _pose_of_last(self, before: FloatArray, after: FloatArray) -> FloatArray | None:
        """Pose (3, 4) of the last frame in the first, with the gyroscope's rotation if the images support it.

        A pose that contradicts the gyroscope is not believed at once, as a few matches often fit a wrong
        rotation; after some tries it is, as the sensor may be wrong.
        """
        settings, first, last = self._settings, self.frames[0], self.frames[-1]
        names = f"frames {first.number} and {last.number}"
        least_px = settings.start_parallax_px / 2
        free = self._free_pose(before, after, least_px)
        if free.failure == "rotation only" and not self._runs_out(len(before)):
            # Of a long way along a plane, as above flat ground, a rotation explains nearly all.
            along = self._free_pose(before, after, _LEFT_BY_ROTATION_PX)
            is_long = along.median_parallax_px >= _LONG_WAY * settings.start_parallax_px
            free = along if along.success and is_long else free
        self.reason = f"{names}: {free.message}"
        turn = self._sensors.rotation(first.t_s, last.t_s)
        if turn is None:
            return free.camera if free.success else None
        by_rotation = relative_pose_of_rotation(
            before, after, self._intrinsics, turn, min_inliers=settings.min_inliers, seed=settings.seed
        )
        if self._contradictions <= _DOUBTS and _is_supported(by_rotation, free, len(before)):
            self.reason = (
                f"{names}: median parallax {by_rotation.median_parallax_px:.3g} px after removing the "
                "gyroscope's rotation"
            )
            return by_rotation.camera if by_rotation.median_parallax_px >= least_px else None
        self._contradictions += 1
        if self._remove_biases():
            self._contradictions = 0
        if not free.success:
            return None
        angle = so3.rotation_angle(turn.T @ free.camera[:, :3])
        self.reason = f"{names}: the rotation differs by {np.degrees(angle):.2g}° from the gyroscope's"
        return free.camera if angle <= SAME_TURN_RAD or self._contradictions > _DOUBTS else None

    def _free_pose(self, before: FloatArray, after: FloatArray, min_parallax_px: float) -> RelativePose:
        """Pose of the last frame by the images alone."""
        return relative_pose(
            before,
            after,
            self._intrinsics,
            min_parallax_px=min_parallax_px,
            max_iterations=RANSAC_ITERATIONS,
            seed=self._settings.seed,
        )

    def _remove_biases(self) -> bool:
        """Remove biases of gyroscopes that the frames so far show; whether there were any."""
        some = self.frames[:: max(1, len(self.frames) // _FRAMES_FOR_BIAS)]
        return remove_biases(some, self._intrinsics, self._sensors, self._settings)

    def _constrain(self, world: WorldMap) -> None:
        """Constrain the rotations of the start by a gyroscope, with the weights of its declared σ."""
        for before, keyframe in pairwise(world.keyframes):
            rotation = keyframe.pose[:, :3]
            measured = self._sensors.measure(before.t_s, keyframe.t_s, rotation, metric=False)
            agreeing = [
                m for m in measured if m.sigma and _agrees_with_gyroscope(m, m.sigma, before, keyframe)
            ]
            keyframe.constraints = presumed_weights(world, keyframe, before, agreeing)

    def _map(self, keyframes: list[tuple[Frame, FloatArray]]) -> WorldMap:
        world = WorldMap(self._intrinsics)
        for frame, pose in keyframes:
            world.add(frame, pose)
        return world

    def _adjusted(self, world: WorldMap) -> bool:
        """Adjust the three keyframes; whether images agree with the gyroscope, and enough points are left."""
        settings = self._settings
        local = world.around(3)
        local.problem.fixed_cameras[0] = True
        groups = constraint_groups(world, local)
        alone = local.problem.copy()
        cost = _cost_of_images(local.problem, groups)
        if groups and _images_contradict(cost, _cost_of_images(alone, []), alone, groups):
            self.reason = "the first three keyframes contradict the rotations of the gyroscope"
            self._contradictions += 1
            return False
        world.take(local)
        drop_outliers(world, local, settings)
        shared = len(common(world.keyframes[0].view, world.keyframes[2].view)[0])
        points = np.count_nonzero(world.known)
        if points < max(settings.min_inliers, settings.start_point_ratio * shared):
            self.reason = f"the first three keyframes yield only {points} points from {shared} tracks"
            return False
        return True


def _is_supported(by_rotation: RelativePose, free: RelativePose, matches: int) -> bool:
    """Whether a pose with the gyroscope's rotation has nearly as many inliers as the images' own pose."""
    best = 0 if free.failure == "rotation only" else free.num_inliers
    enough = by_rotation.num_inliers >= max(_SUPPORT * best, _LEAST_SHARE * matches)
    return by_rotation.success and enough


def _cost_of_images(problem: Problem, groups: Sequence[ConstraintGroup]) -> float:
    """Adjust a problem with constraints; the robust cost of its pixels at the optimum."""
    loss, scale_px = LOCAL_LOSS
    summary = solve(problem, constraints=groups, threads=1, loss=loss, loss_scale_px=scale_px)
    summary.require_uninterrupted()
    return float(summary.final_cost - sum(after for _, after in summary.constraint_costs.values()))


def _images_contradict(
    with_rotations: float, alone: float, problem: Problem, groups: Sequence[ConstraintGroup]
) -> bool:
    """Whether constraints on rotations raise the cost of the images by more than noise explains.

    Inliers do not tell: in a narrow view all of them fit a rotation that is off by degrees.
    """
    rotations = sum(group.num_members for group in groups)
    redundancy = 2 * problem.num_observations - 3 * problem.num_points - _FREEDOM_OF_CAMERAS
    noise = max(alone, 0.5 * redundancy * _LEAST_NOISE_PX**2)
    return (with_rotations - alone) * redundancy > _DENIED_SIGMAS**2 * 3 * rotations * noise


def _agrees_with_gyroscope(
    measurement: Measurement, sigma: float, before: Keyframe, keyframe: Keyframe
) -> bool:
    """Whether a rotation of the start agrees with the gyroscope."""
    turn = before.pose[:, :3].T @ keyframe.pose[:, :3]
    angle = float(so3.rotation_angle(np.asarray(measurement.value).T @ turn))
    return angle < _SAME_TURN_SIGMAS * sigma
