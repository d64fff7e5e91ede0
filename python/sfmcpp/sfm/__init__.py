"""Structure from motion: from photos or tracks to a model (thesis ch. 3)."""

from sfmcpp.sfm.match_graph import MatchGraph, Pair
from sfmcpp.sfm.result import GpsOutcome, ImageOutcome, SfmRun

__all__ = ["GpsOutcome", "ImageOutcome", "MatchGraph", "Pair", "SfmRun"]
