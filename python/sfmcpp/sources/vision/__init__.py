"""Images: the frames of a folder or of a video, and the tracks of corners through them."""

from sfmcpp.sources.vision.frames import PICTURES, VIDEOS, Frames, open_frames
from sfmcpp.sources.vision.klt import FeatureTracks, follow_features, track_features
from sfmcpp.sources.vision.klt_settings import CORNERS, KltSettings

__all__ = [
    "CORNERS",
    "PICTURES",
    "VIDEOS",
    "FeatureTracks",
    "Frames",
    "KltSettings",
    "follow_features",
    "open_frames",
    "track_features",
]
