"""Simulated corner tracks, with drift, limited lengths and wrong tracks."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sfmcpp.model.arrays import FloatArray, IndexArray
from sfmcpp.model.checks import require_count, require_not_negative, require_share
from sfmcpp.sources.synthetic.image_geometry import ImageGeometry
from sfmcpp.sources.synthetic.sight import Lookout, Sight


@dataclass(frozen=True)
class Tracker:
    """How a tracker of corners (KLT) behaves.

    It keeps up to `max_tracks` tracks alive: in every frame it takes up corners it does not follow, anywhere
    in the image, and follows each until it leaves the image, is hidden or is lost. A track begins exactly at
    its corner. From then on each frame is matched to the one before, so that errors add up to a random walk;
    on top of it each frame has an error of its own. Some tracks cling to the edge of something nearer, a
    reflection or a shadow, and slide away evenly.

    The defaults are those of a poor tracker. One thing set them, before any sensor was fused: the drift of
    SLAM without sensors on :func:`vehicle_drive` and :func:`table_walk`. The thesis tells of 12.8 m and a
    scale of 0.81 on 130 m of street, and of 16 cm round a table (§5.4).

    Attributes
    ----------
    max_tracks : int
        Tracks alive at once.
    sigma_px : float
        Standard deviation of the error of each frame alone, of each coordinate [px].
    drift_px : float
        Standard deviation of what each further frame adds to the random walk of each coordinate [px].
    loss : float
        Probability to lose a track in a frame, though its corner is in sight.
    sliding : float
        Share of the tracks that slide.
    slide_px : float
        Standard deviation of each coordinate of their speed [px per frame].
    """

    max_tracks: int = 100
    sigma_px: float = 0.5
    drift_px: float = 0.3
    loss: float = 0.04
    sliding: float = 0.02
    slide_px: float = 0.5

    def __post_init__(self) -> None:
        require_count("max_tracks", self.max_tracks)
        for name in ("sigma_px", "drift_px", "slide_px"):
            require_not_negative(name, getattr(self, name))
        for name in ("loss", "sliding"):
            require_share(name, getattr(self, name))


@dataclass(frozen=True, eq=False)
class Tracks:
    """Observations of tracks, by frame and then by track.

    Attributes
    ----------
    frame_index, track_index : (M,) int32
        Frame and track of each.
    pixels : (M, 2) float64
        Where the frame sees it [px].
    point_index : (T,) int32
        Point of the scene behind each of T tracks; a point can have several, one after the other.
    """

    frame_index: IndexArray
    track_index: IndexArray
    pixels: FloatArray
    point_index: IndexArray


def track(
    geometry: ImageGeometry,
    cameras: FloatArray,
    points: FloatArray,
    tracker: Tracker,
    rng: np.random.Generator,
    sight: Sight,
) -> Tracks:
    """Follow `points` (N, 3) through the images of `cameras` (F, 3, 4), in the order of time."""
    lookout = Lookout(geometry, points, sight)
    alive = _Alive(tracker, len(points), rng)
    frames = []
    for camera in cameras:
        seen, exact = lookout.view(camera)
        frames.append(alive.next_frame(seen, exact, geometry))
    counts = [len(tracks) for tracks, _ in frames]
    return Tracks(
        np.repeat(np.arange(len(cameras), dtype=np.int32), counts),
        np.concatenate([tracks for tracks, _ in frames]),
        np.concatenate([pixels for _, pixels in frames]),
        np.array(alive.point_of_track, dtype=np.int32),
    )


@dataclass
class _Alive:
    """The tracks that are followed, and how far each is from its corner."""

    tracker: Tracker
    num_points: int
    rng: np.random.Generator
    point_of_track: list[int] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._track_of_point = np.full(self.num_points, -1, dtype=np.int32)
        self._walk = np.zeros((self.num_points, 2))
        self._slide = np.zeros((self.num_points, 2))

    def next_frame(
        self, seen: IndexArray, exact: FloatArray, geometry: ImageGeometry
    ) -> tuple[IndexArray, FloatArray]:
        """Tracks of a frame, ascending, and their pixels, from the points it sees and their exact pixels."""
        followed = self._track_of_point[seen] >= 0
        self._walk[seen[followed]] += self._steps(int(followed.sum())) + self._slide[seen[followed]]
        noisy = exact + self._walk[seen] + self.tracker.sigma_px * self.rng.standard_normal(exact.shape)
        kept = (
            followed & self._inside(noisy, geometry) & (self.rng.uniform(size=len(seen)) >= self.tracker.loss)
        )
        self._end_all_but(seen[kept])
        fresh = self._begin(np.flatnonzero(~followed), seen)
        noisy[fresh] = exact[fresh]
        rows = np.concatenate([np.flatnonzero(kept), fresh])
        tracks = self._track_of_point[seen[rows]]
        order = np.argsort(tracks)
        return tracks[order], noisy[rows][order]

    def _steps(self, count: int) -> FloatArray:
        return np.asarray(self.tracker.drift_px * self.rng.standard_normal((count, 2)))

    @staticmethod
    def _inside(pixels: FloatArray, geometry: ImageGeometry) -> NDArray[np.bool_]:
        offsets = np.abs(pixels - geometry.principal_point_px)
        return np.asarray((offsets <= geometry.half_size_px).all(axis=1))

    def _end_all_but(self, points: IndexArray) -> None:
        tracks = self._track_of_point[points]
        self._track_of_point[:] = -1
        self._track_of_point[points] = tracks

    def _begin(self, free: NDArray[np.intp], seen: IndexArray) -> NDArray[np.intp]:
        """Take up as many of the rows `free` of `seen` as there is room for."""
        room = self.tracker.max_tracks - np.count_nonzero(self._track_of_point >= 0)
        rows = np.sort(self.rng.permutation(free)[: max(room, 0)])
        chosen = seen[rows]
        first = len(self.point_of_track)
        self._track_of_point[chosen] = np.arange(first, first + len(chosen), dtype=np.int32)
        self.point_of_track += chosen.tolist()
        self._walk[chosen] = 0.0
        slides = self.rng.uniform(size=len(chosen)) < self.tracker.sliding
        speeds = self.tracker.slide_px * self.rng.standard_normal((len(chosen), 2))
        self._slide[chosen] = np.where(slides[:, None], speeds, 0.0)
        return rows
