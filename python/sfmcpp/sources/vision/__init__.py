"""Images: frames and tracks of corners through them; photos, what is detected in them, and what matches."""

from sfmcpp.sources.vision.features import (
    FEATURE_KINDS,
    FeatureSettings,
    detect,
    detect_in,
    detector_version,
)
from sfmcpp.sources.vision.frames import Frames, open_frames
from sfmcpp.sources.vision.images import PICTURES, VIDEOS, one_opencv_thread
from sfmcpp.sources.vision.klt import CORNERS, KltSettings, follow_features
from sfmcpp.sources.vision.masks import read_mask
from sfmcpp.sources.vision.matching import match
from sfmcpp.sources.vision.pairs import MATCHERS, choose_pairs
from sfmcpp.sources.vision.photos import (
    PhotoFolder,
    open_photos,
    read_color,
    read_gray,
    thumbnail_jpeg,
    without_copies,
)
from sfmcpp.sources.vision.undistortion import undistort_photos

__all__ = [
    "CORNERS",
    "FEATURE_KINDS",
    "MATCHERS",
    "PICTURES",
    "VIDEOS",
    "FeatureSettings",
    "Frames",
    "KltSettings",
    "PhotoFolder",
    "choose_pairs",
    "detect",
    "detect_in",
    "detector_version",
    "follow_features",
    "match",
    "one_opencv_thread",
    "open_frames",
    "open_photos",
    "read_color",
    "read_gray",
    "read_mask",
    "thumbnail_jpeg",
    "undistort_photos",
    "without_copies",
]
