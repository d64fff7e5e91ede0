"""SLAM: a camera's trajectory and a map of points, from tracks, keyframe by keyframe."""

from sfmcpp.model.frames import Frame, View
from sfmcpp.slam.drive_run import SlamRun, motion_sensors, run
from sfmcpp.slam.frame_run import run_slam
from sfmcpp.slam.measurement import Measurement, MotionSensor
from sfmcpp.slam.motion_sensors import Gyroscope, Odometer
from sfmcpp.slam.path import Path
from sfmcpp.slam.position_sensors import Gps, Ins
from sfmcpp.slam.result import FinalAdjustment, KeyframeRecord, SlamResult
from sfmcpp.slam.scale_drift import scale_sigmas
from sfmcpp.slam.settings import SlamSettings
from sfmcpp.slam.slam import Slam
from sfmcpp.slam.world_map import Keyframe, WorldMap
from sfmcpp.sources.frames import FrameSource, TrackSequence

__all__ = [
    "FinalAdjustment",
    "Frame",
    "FrameSource",
    "Gps",
    "Gyroscope",
    "Ins",
    "Keyframe",
    "KeyframeRecord",
    "Measurement",
    "MotionSensor",
    "Odometer",
    "Path",
    "Slam",
    "SlamResult",
    "SlamRun",
    "SlamSettings",
    "TrackSequence",
    "View",
    "WorldMap",
    "motion_sensors",
    "run",
    "run_slam",
    "scale_sigmas",
]
