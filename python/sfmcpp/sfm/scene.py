"""What is to be reconstructed: images, tracks and cameras, and the maps that grow from them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sfmcpp.map import Map
from sfmcpp.sfm.cameras import Cameras
from sfmcpp.sfm.match_graph import MatchGraph
from sfmcpp.sfm.tracks import Tracks, build_tracks


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
    """

    graph: MatchGraph
    cameras: Cameras
    tracks: Tracks

    @classmethod
    def of(cls, graph: MatchGraph, cameras: Cameras) -> Scene:
        """Join the matches of a graph into tracks."""
        return cls(graph, cameras, build_tracks(graph))

    def new_map(self) -> Map:
        """Map of all images without a pose, whose points are the tracks, without a position."""
        world, features = Map("perspective"), self.graph.features
        world.add_cameras(
            self.cameras.intrinsics,
            fixed=self.cameras.fixed,
            sizes=self.cameras.sizes,
            names=self.cameras.names,
        )
        world.add_points(np.full((self.tracks.count, 3), np.nan))
        world.add_images(
            [photo.name for photo in self.graph.photos],
            self.cameras.of_image,
            np.diff(self.tracks.begin),
            np.concatenate([np.empty((0, 2)), *(some.pixels for some in features)]),
            points=self.tracks.track,
            colors=np.concatenate([np.empty((0, 3), dtype=np.uint8), *(some.colors for some in features)]),
            scales=np.concatenate([np.empty(0), *(some.scales for some in features)]),
        )
        return world
