"""Images: the frames of a folder or of a video, and the tracks of corners through them."""

from sfmcpp.sources.vision.frames import PICTURES, VIDEOS, Frames, open_frames
from sfmcpp.sources.vision.klt import CORNERS, KltSettings, follow_features
from sfmcpp.sources.vision.matching import match

__all__ = [
    "CORNERS",
    "PICTURES",
    "VIDEOS",
    "Frames",
    "KltSettings",
    "follow_features",
    "match",
    "open_frames",
]
