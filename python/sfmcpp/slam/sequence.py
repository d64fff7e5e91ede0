"""What a SLAM run reads: which tracks each frame sees, and where."""

from sfmcpp.model.frames import Frame, View, common
from sfmcpp.sources.frames import FrameSource, TrackSequence

__all__ = ["Frame", "FrameSource", "TrackSequence", "View", "common"]
