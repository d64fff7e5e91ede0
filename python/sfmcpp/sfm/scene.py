"""Input of a reconstruction: images, tracks and cameras; new maps are made from it."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass, field

import numpy as np

from sfmcpp.map import Map
from sfmcpp.sfm.cameras import Cameras
from sfmcpp.sfm.match_graph import MatchGraph
from sfmcpp.sfm.positions import Positions
from sfmcpp.sfm.tracks import Tracks, build_tracks

# Standard deviation of a blob of scale s: ``σ² = least² + (factor s)²``. From residuals of SIFT on photos.
SIGMA_PER_SCALE, LEAST_SIGMA_PX = 0.08, 0.15
# Of a keypoint whose scale is not known [px]: tracks of Malaga have 0.12, the Dinosaur 0.2, Ladybug 0.3.
USUAL_SIGMA_PX = 0.2


@dataclass(frozen=True, eq=False)
class Scene:
    """Images with their cameras, and which keypoints show the same point.

    Attributes
    ----------
    graph : MatchGraph
        Images, features and pairs.
    cameras : Cameras
        First intrinsics, and which image has which.
    tracks : Tracks
        Keypoints that show the same point.
    positions : Positions or None
        Where the images were taken, as far as that is known.
    """

    graph: MatchGraph
    cameras: Cameras
    tracks: Tracks
    positions: Positions | None = None
    # What new maps are copies of, once there is a second: most scenes are one model, which needs no other.
    _blank: list[Map | None] = field(init=False, repr=False, default_factory=list)

    @classmethod
    def of(cls, graph: MatchGraph, cameras: Cameras) -> Scene:
        """Join the matches of a graph into tracks."""
        return cls(graph, cameras, build_tracks(graph))

    def new_map(self) -> Map:
        """Map of all images without a pose, whose points are the tracks, without a position."""
        if not self._blank:
            self._blank.append(None)
            return self._made_map()
        blank = self._blank[0] = self._blank[0] or self._made_map()
        return deepcopy(blank)

    def _made_map(self) -> Map:
        world, features = Map("perspective"), self.graph.features
        world.add_cameras(
            self.cameras.intrinsics,
            fixed=self.cameras.fixed,
            sizes=self.cameras.sizes,
            ids=self.cameras.ids,
            names=self.cameras.names,
        )
        world.add_points(np.full((self.tracks.count, 3), np.nan))
        world.add_images(
            [photo.name for photo in self.graph.photos],
            self.cameras.of_image,
            np.diff(self.tracks.begin),
            np.concatenate([np.empty((0, 2)), *(some.pixels for some in features)]),
            points=self.tracks.track,
            ids=self.graph.image_ids,
            colors=np.concatenate([np.empty((0, 3), dtype=np.uint8), *(some.colors for some in features)]),
            scales=np.concatenate([np.empty(0), *(some.scales for some in features)]),
        )
        world.set_sigmas_by_scale(SIGMA_PER_SCALE, LEAST_SIGMA_PX)
        world.keypoint_covariances[np.isnan(world.keypoint_scales)] = USUAL_SIGMA_PX**2 * np.array(
            [1.0, 0.0, 1.0]
        )
        return world
