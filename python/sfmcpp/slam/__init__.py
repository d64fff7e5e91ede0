"""SLAM: a camera's trajectory and a map of points, from tracks, keyframe by keyframe."""

from sfmcpp.slam.sensing import Gyroscope, Measurement, MotionSensor, Odometer
from sfmcpp.slam.sequence import TrackSequence
from sfmcpp.slam.settings import SlamSettings
from sfmcpp.slam.slam import KeyframeRecord, Slam, SlamResult, run_slam
from sfmcpp.slam.world_map import Keyframe, WorldMap

__all__ = [
    "Gyroscope",
    "Keyframe",
    "KeyframeRecord",
    "Measurement",
    "MotionSensor",
    "Odometer",
    "Slam",
    "SlamResult",
    "SlamSettings",
    "TrackSequence",
    "WorldMap",
    "run_slam",
]
