"""Structure from motion: from photos or tracks to a model (thesis ch. 3)."""

from sfmcpp.sfm.cache import Cache
from sfmcpp.sfm.control_points import Controlled, ControlOutcome, fit_control_points
from sfmcpp.sfm.front_end import FrontEndSettings, build_match_graph
from sfmcpp.sfm.georeference import Georeferenced, georeference
from sfmcpp.sfm.imported_matches import match_graph_of_arrays, match_graph_of_database
from sfmcpp.sfm.match_graph import MatchGraph, Pair
from sfmcpp.sfm.result import GpsOutcome, ImageOutcome, SfmRun
from sfmcpp.sfm.run import reconstruct
from sfmcpp.sfm.settings import IncrementalSettings

__all__ = [
    "Cache",
    "ControlOutcome",
    "Controlled",
    "FrontEndSettings",
    "Georeferenced",
    "GpsOutcome",
    "ImageOutcome",
    "IncrementalSettings",
    "MatchGraph",
    "Pair",
    "SfmRun",
    "build_match_graph",
    "fit_control_points",
    "georeference",
    "match_graph_of_arrays",
    "match_graph_of_database",
    "reconstruct",
]
