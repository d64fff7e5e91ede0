"""Images: the frames of a folder or of a video, and the tracks of corners through them."""

from sfmcpp.vision.frames import PICTURES, VIDEOS, Frames, open_frames
from sfmcpp.vision.klt import FeatureTracks, KltSettings, track_features

__all__ = ["PICTURES", "VIDEOS", "FeatureTracks", "Frames", "KltSettings", "open_frames", "track_features"]
