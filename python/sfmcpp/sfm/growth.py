"""Incremental growth of one model, image by image from an initial pair (thesis algorithm 5)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfmcpp.geometry import (
    PoseEstimate,
    relative_pose,
    resection,
    resection_with_focal,
    triangulation_angles_deg,
)
from sfmcpp.map import Map
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.model.threads import on_threads, thread_count
from sfmcpp.sfm.adjustment import FINE, ROUGH, adjust_all, adjust_around, adjust_young
from sfmcpp.sfm.camera_choice import choose_camera_model
from sfmcpp.sfm.contradictions import epipolar_errors_px
from sfmcpp.sfm.focal_lengths import held_distortions, hold_undetermined_focals
from sfmcpp.sfm.loops import close_loops
from sfmcpp.sfm.map_backup import MapBackup
from sfmcpp.sfm.match_graph import Pair
from sfmcpp.sfm.scene import Scene
from sfmcpp.sfm.settings import IncrementalSettings
from sfmcpp.sfm.stops import heed_stop
from sfmcpp.sfm.structure import Structure

# Told after each image what there is of the model.
Told = Callable[[Map], None]
# Pairs that are looked at and those that are tried at each angle, and how far the angle is lowered.
_START_PAIRS = 200
_START_TRIES = 20
_LEAST_START_ANGLE_DEG = 2.0
# Cells of the finest grid that tells how well points are spread over an image, as a power of two.
_SPREAD_LEVELS = 5
_LAST_ROUNDS = 4
# An image that has lost its points so often is left out: others might come and go for ever.
_MOST_LOSSES = 3
# A pose is wrong if less than this part of the image's matches with the model agrees with it, by a limit for
# outliers that right poses keep in a young model, too. The pairs with most matches tell.
_LEAST_AGREEING, _FAR, _MOST_PAIRS = 0.25, 4, 20
# So is a place with which fewer matches agree than this part of those with images that turned there, and have
# no place. Images are at one place that are nearer to each other than this part of the way to what they see.
_LEAST_OF_TURNED, _ONE_PLACE = 0.05, 0.02


class Growth:
    """One model: a map, its structure, and how it takes in images.

    Parameters
    ----------
    scene : Scene
        Images, cameras and tracks.
    settings : IncrementalSettings
        Thresholds and seed.
    elsewhere : (I,) bool
        Images that have a pose in another model: the first pair is none of them, and it takes in so many
        of them as are needed to join both.
    world : Map, optional
        A model of the scene to go on with.

    Attributes
    ----------
    world : Map
        What there is of the model.
    reasons : dict of int to str
        Why images that were tried have no pose.
    """

    def __init__(
        self,
        scene: Scene,
        settings: IncrementalSettings,
        elsewhere: BoolArray,
        world: Map | None = None,
    ) -> None:
        self._scene, self._settings, self._elsewhere = scene, settings, elsewhere
        self.world = scene.new_map() if world is None else world
        self.structure = Structure(self.world, scene.tracks.track, scene.tracks.apart, settings)
        self.reasons: dict[int, str] = {}
        self._adjusted = (0, 0)
        self._losses = np.zeros(self.world.num_images, dtype=np.intp)
        self._scores: dict[int, int] = {}

    def start(self) -> bool:
        """Find a first pair; whether there is one."""
        taken = self._elsewhere
        pairs = [p for p in self._scene.graph.pairs if not (taken[p.first] or taken[p.second])]
        pairs = [p for p in pairs if p.geometry.kind in ("general", "planar")]
        pairs.sort(key=lambda p: -p.num_verified)
        del pairs[_START_PAIRS:]
        poses: list[tuple[FloatArray, float]] = []
        angle_deg = self._settings.start_angle_deg
        while angle_deg >= _LEAST_START_ANGLE_DEG:
            if any(
                self._start_with(*found, angle_deg)
                for found in self._wide_angle_pairs(pairs, poses, angle_deg / 2)
            ):
                return True
            angle_deg /= 2
        return False

    def _wide_angle_pairs(
        self, pairs: list[Pair], poses: list[tuple[FloatArray, float]], angle_deg: float
    ) -> Iterator[tuple[Pair, FloatArray]]:
        """The first pairs seen under an angle, with the pose of the second image, which `poses` keeps."""
        count, threads = 0, thread_count()
        for number, pair in enumerate(pairs):
            if number == len(poses):
                poses += on_threads(self._relative_pose, pairs[number : number + threads], threads)
            camera, seen_deg = poses[number]
            if seen_deg >= angle_deg:
                yield pair, camera
                count += 1
            if count == _START_TRIES:
                return

    def _start_with(self, pair: Pair, second: FloatArray, angle_deg: float) -> bool:
        """Try a pair: its images get poses and points, or nothing changes."""
        world, settings = self.world, self._settings
        before, structure = MapBackup.of(world), self.structure.state()
        both = np.array([pair.first, pair.second])
        is_good = False
        try:
            world.poses[both] = np.eye(3, 4), second
            self.structure.triangulate(both)
            if np.count_nonzero(world.known) >= settings.start_points:
                self._adjust_all(rounds=2, keep_intrinsics=True)
                is_good = self._is_good_start(angle_deg)
        finally:
            if not is_good:
                before.restore(world)
                self.structure.restore(*structure)
        return is_good

    def _relative_pose(self, pair: Pair) -> tuple[FloatArray, float]:
        """Pose (3, 4) of the second image in the frame of the first, and the median angle of the rays [deg].

        The angle is not a number where the pose is not known.
        """
        if np.isfinite(pair.geometry.camera).all():
            return pair.geometry.camera, pair.geometry.median_angle_deg
        world, begin = self.world, self.world.keypoint_begin
        rows = pair.verified + begin[[pair.first, pair.second]]
        first, second = world.intrinsics[world.image_cameras[[pair.first, pair.second]]]
        found = relative_pose(
            world.keypoints[rows[:, 0]],
            world.keypoints[rows[:, 1]],
            first,
            second,
            threshold_px=self._settings.outlier_px,
            seed=self._settings.seed,
        )
        if found.failure not in ("", "ambiguous"):
            return found.camera, np.nan
        return found.camera, float(np.degrees(2 * found.median_parallax_px / (first[0] + second[0])))

    def _is_good_start(self, angle_deg: float) -> bool:
        local = self.world.whole_problem(2)
        if local.problem.num_points < self._settings.start_points:
            return False
        angles = triangulation_angles_deg(local.problem, local.problem.points)
        return bool(np.median(angles) >= angle_deg / 2)

    def grow(self, on_image: Told) -> None:
        """Take in image after image until none can be, then adjust all to the end.

        A stop, which any adjustment may end with, leaves no outliers.
        """
        try:
            self._grow(on_image)
        except KeyboardInterrupt:
            if self.world.registered.any():
                self.structure.drop_outliers(self.world.whole_problem(2))
                self._give_up_lost_images()
            raise

    def _grow(self, on_image: Told) -> None:
        retried = False
        while True:
            if self._register_next():
                on_image(self.world)
                retried = False
            elif not retried:
                self._adjust_all(rounds=2)
                retried = True
            else:
                break
        self._give_up_turned_images()
        self.finish()

    def finish(self) -> None:
        """Adjust everything, leave outliers out, find points and observations again, until it rests.

        Where the camera model is to be chosen, that is done then, and all of it once more.
        """
        self._adjust_until_stable()
        if self._scene.cameras.model_is_open and self.world.registered.any():
            open_ones = hold_undetermined_focals(self.world, self._scene.cameras, self._settings)
            if len(open_ones):
                self._adjust_until_stable()
            if not self.world.registered.any():  # where it is held, nothing fits
                return
            simple = np.union1d(open_ones, held_distortions(self.world, self._scene.cameras))
            choose_camera_model(self.world, self._settings, self._scene.positions, simple)
            self._adjust_until_stable()

    def _adjust_until_stable(self) -> None:
        for _ in range(_LAST_ROUNDS):
            if self._adjust_all(rounds=1, fine=True) == 0:
                break

    def _register_next(self) -> bool:
        """Take in the image that sees the points of the model best; whether there is one."""
        for image in self._candidates():
            if self._register(int(image)):
                del self.reasons[int(image)]
                return True
        return False

    def _candidates(self) -> NDArray[np.intp]:
        """Images without a pose that see enough points, those first that see most, and spread best."""
        world, sightings = self.world, self.structure.sightings
        sightings.update()
        counts = np.where(world.registered, 0, sightings.counts)
        if np.count_nonzero(world.registered & self._elsewhere) >= self._settings.overlap_images:
            counts[self._elsewhere] = 0
        for image in np.flatnonzero(~world.registered):
            self.reasons[int(image)] = (
                f"it sees only {counts[image]} points of the model, {self._settings.min_inliers} are needed"
            )
        for image in np.flatnonzero(~world.registered & (self._losses >= _MOST_LOSSES)):
            counts[image] = 0
            self.reasons[int(image)] = (
                f"it lost its points each of the {_MOST_LOSSES} times that it had a pose"
            )
        images = np.flatnonzero(counts >= self._settings.min_inliers)
        scores = [self._coverage_score(int(image)) for image in images]
        return np.asarray(images[np.argsort(-np.asarray(scores), kind="stable")])

    def _coverage_score(self, image: int) -> int:
        """How much of an image the points that it sees cover; computed where these have changed."""
        sightings = self.structure.sightings
        if sightings.changed[image]:
            sightings.changed[image] = False
            rows = self.world.keypoints_of([image])
            self._scores[image] = self._cells_with_points(image, rows[sightings.sees[rows]])
        return self._scores.get(image, 0)

    def _cells_with_points(self, image: int, rows: NDArray[np.intp]) -> int:
        """Cells of finer and finer grids that hold points, the finer ones counting more (COLMAP's rule)."""
        world, pixels = self.world, self.world.keypoints[rows]
        size = np.maximum(world.camera_sizes[world.image_cameras[image]], np.ptp(pixels, axis=0) + 1)
        score = 0
        for level in range(1, _SPREAD_LEVELS + 1):
            cells = np.floor(pixels / size * 2**level).astype(np.int64)
            score += 2**level * len(np.unique(cells[:, 0] * 4096 + cells[:, 1]))
        return score

    def _register(self, image: int) -> bool:
        """Give an image a pose by resection from the points it sees, and what it adds to the model."""
        heed_stop()
        world = self.world
        rows = self.structure.seeing_known(image)
        camera = int(world.image_cameras[image])
        focal_px = world.intrinsics[camera, 0]
        found = self._resection(rows, camera)
        if not found.success:
            self.reasons[image] = f"no pose explains the {len(rows)} points it sees: {found.message}"
            return False
        world.poses[image] = found.camera
        if (wrong := self._contradicted_by(image)) is not None:
            world.poses[image], world.intrinsics[camera, 0] = np.nan, focal_px
            self.reasons[image] = f"its pose contradicts its matches with other images, as {wrong}"
            return False
        errors_px = self.structure.errors_px(rows, world.keypoint_points[rows])
        world.forget(rows[errors_px > 2 * self._settings.outlier_px])
        self._extend_structure(image)
        return True

    def _contradicted_by(self, image: int) -> str | None:
        """Image of the model whose matches deny the pose of an image most, if most matches deny it.

        A camera that turns away from a scene sees hardly a point of it: some wrong matches give it any pose,
        though thousands tell how it turned.
        """
        world, graph = self.world, self._scene.graph
        inside = world.registered.tolist()
        pairs = [p for p in graph.verified_pairs[image] if inside[p.first] and inside[p.second]]
        del pairs[_MOST_PAIRS:]
        errors = [epipolar_errors_px(graph, world, pair) for pair in pairs]
        agree = [np.count_nonzero(some <= _FAR * self._settings.outlier_px) for some in errors]
        counts = [len(some) for some in errors]
        if not pairs or sum(agree) >= _LEAST_AGREEING * sum(counts):
            return None
        worst = pairs[int(np.argmax(np.subtract(counts, agree)))]
        return graph.photos[worst.first if worst.second == image else worst.second].name

    def _resection(self, rows: NDArray[np.intp], camera: int) -> PoseEstimate:
        """Pose of an image from the points that its keypoints `rows` see; its focal length too if a guess."""
        world, settings = self.world, self._settings
        seen = world.points[world.keypoint_points[rows]], world.keypoints[rows], world.intrinsics[camera]
        limits: dict[str, Any] = {
            "threshold_px": settings.resection_threshold_px,
            "min_inliers": settings.min_inliers,
            "min_inlier_ratio": settings.min_inlier_ratio,
            "seed": settings.seed,
        }
        if not self._has_guessed_focal(camera):
            return resection(*seen, **limits)
        limits["threshold_px"] *= 2
        if not (world.registered & (world.image_cameras == camera)).any():
            free = resection_with_focal(*seen, **limits)
            if free.success:
                world.intrinsics[camera, 0] = free.focal_px
                return free
        return resection(*seen, **limits)

    def _has_guessed_focal(self, camera: int) -> bool:
        """Whether the focal length of a camera was guessed and not adjusted yet."""
        world = self.world
        used = world.registered & (world.image_cameras == camera)
        adjusted = used.any() and np.count_nonzero(world.registered) >= self._settings.intrinsics_images
        return bool(self._scene.cameras.guessed[camera] and not adjusted)

    def _extend_structure(self, image: int) -> None:
        """Points and observations that a new image brings, and the adjustment around it or of all."""
        world, settings = self.world, self._settings
        self.structure.triangulate(np.array([image]))
        images, points = np.count_nonzero(world.registered), np.count_nonzero(world.known)
        grown = 1 + settings.growth
        if images >= grown * self._adjusted[0] or points >= grown * self._adjusted[1]:
            self._adjust_all(rounds=1)
            return
        self.structure.drop_outliers(adjust_around(world, image, settings))
        self.structure.complete(np.array([image]))

    def _adjust_all(self, *, rounds: int, fine: bool = False, keep_intrinsics: bool = False) -> int:
        """Adjust the whole model and its structure; how much of the structure has changed last."""
        world, structure, changed = self.world, self.structure, 0
        close_loops(structure, self._settings)
        for _ in range(rounds):
            if not world.registered.any():  # all have lost their points
                break
            if fine:
                local = adjust_all(world, self._settings, **FINE)
            else:
                local = adjust_young(world, self._settings, keep_intrinsics=keep_intrinsics, **ROUGH)
            changed = structure.drop_outliers(local)
            self._give_up_lost_images()
            registered = np.flatnonzero(world.registered)
            changed += structure.merge()
            changed += structure.complete(registered)
            changed += structure.triangulate(registered)
        self._adjusted = (int(np.count_nonzero(world.registered)), int(np.count_nonzero(world.known)))
        return changed

    def _give_up_turned_images(self) -> None:
        """Take the pose from images that few wrong matches may have placed: of a camera that turned away.

        Nearly all of their matches are with images that tell how it turned, and have no place themselves.
        """
        world, graph = self.world, self._scene.graph
        wrong, placed = [], (world.registered | self._elsewhere).tolist()
        for image in np.flatnonzero(world.registered & ~self._elsewhere).tolist():
            pairs = graph.verified_pairs[image]
            without = [p for p in pairs if not (placed[p.first] and placed[p.second])]
            turned = sum(p.num_verified for p in without if p.geometry.kind in ("planar", "rotation"))
            if turned and self._agreeing(image, pairs) < _LEAST_OF_TURNED * turned:
                wrong.append(image)
                self.reasons[image] = (
                    f"{turned} of its matches are with images of the same spot that have no place, hardly "
                    "any with the model: move the camera between photos"
                )
        world.poses[wrong] = np.nan

    def _agreeing(self, image: int, pairs: Sequence[Pair]) -> int:
        """How many matches of an image with images of other places agree with its pose."""
        world, centres = self.world, self.world.poses[:, :, 3]
        known = world.keypoint_points[self.structure.seeing_known(image)]
        depth = np.median(np.linalg.norm(world.points[known] - centres[image], axis=1))
        apart = np.linalg.norm(centres - centres[image], axis=1) > _ONE_PLACE * depth
        inside = [p for p in pairs if apart[p.second if p.first == image else p.first]]
        errors = [epipolar_errors_px(self._scene.graph, world, pair) for pair in inside]
        return sum(int(np.count_nonzero(some <= _FAR * self._settings.outlier_px)) for some in errors)

    def _give_up_lost_images(self) -> None:
        """Take the pose from images that hardly see a point any more, and from one that is left alone."""
        world, sightings = self.world, self.structure.sightings
        sightings.update()
        lost = world.registered & (sightings.counts < self._settings.min_inliers // 2)
        if np.count_nonzero(world.registered & ~lost) == 1:
            lost = world.registered
        world.poses[lost] = np.nan
        self._losses += lost
