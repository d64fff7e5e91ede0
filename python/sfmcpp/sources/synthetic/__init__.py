"""Synthetic problems and drives whose truth is known: scenes, starts, outliers and sensors, all seeded."""

from sfmcpp.sources.synthetic.body_motion import BodySensors
from sfmcpp.sources.synthetic.circle import circle_scene
from sfmcpp.sources.synthetic.city_blocks import city_blocks_scene
from sfmcpp.sources.synthetic.corridor import corridor_scene
from sfmcpp.sources.synthetic.drive import SyntheticDrive
from sfmcpp.sources.synthetic.outliers import add_outliers
from sfmcpp.sources.synthetic.perturbation import perturb
from sfmcpp.sources.synthetic.registry import DRIVES, SCENES
from sfmcpp.sources.synthetic.sphere import sphere_scene
from sfmcpp.sources.synthetic.street_loop import street_loop_scene
from sfmcpp.sources.synthetic.table_walk import table_walk
from sfmcpp.sources.synthetic.tracker import Tracker
from sfmcpp.sources.synthetic.vehicle_drive import vehicle_drive

__all__ = [
    "DRIVES",
    "SCENES",
    "BodySensors",
    "SyntheticDrive",
    "Tracker",
    "add_outliers",
    "circle_scene",
    "city_blocks_scene",
    "corridor_scene",
    "perturb",
    "sphere_scene",
    "street_loop_scene",
    "table_walk",
    "vehicle_drive",
]
