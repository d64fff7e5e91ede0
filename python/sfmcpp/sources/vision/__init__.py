"""Images: the frames of a folder or of a video, and the tracks of corners through them."""

from sfmcpp.sources.vision.frames import VIDEOS, Frames, open_frames
from sfmcpp.sources.vision.images import PICTURES
from sfmcpp.sources.vision.klt import CORNERS, KltSettings, follow_features
from sfmcpp.sources.vision.matching import match
from sfmcpp.sources.vision.pairs import MATCHERS, choose_pairs

__all__ = [
    "CORNERS",
    "MATCHERS",
    "PICTURES",
    "VIDEOS",
    "Frames",
    "KltSettings",
    "choose_pairs",
    "follow_features",
    "match",
    "open_frames",
]
