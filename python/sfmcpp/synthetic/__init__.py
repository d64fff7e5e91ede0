"""Synthetic problems and drives whose truth is known: scenes, starts, outliers and sensors, all seeded."""

from sfmcpp.synthetic.body_motion import BodySensors
from sfmcpp.synthetic.circle import circle_scene
from sfmcpp.synthetic.city_blocks import city_blocks_scene
from sfmcpp.synthetic.corridor import corridor_scene
from sfmcpp.synthetic.drive import SyntheticDrive
from sfmcpp.synthetic.outliers import add_outliers
from sfmcpp.synthetic.perturbation import perturb
from sfmcpp.synthetic.registry import DRIVES, SCENES
from sfmcpp.synthetic.sphere import sphere_scene
from sfmcpp.synthetic.street_loop import street_loop_scene
from sfmcpp.synthetic.table_walk import table_walk
from sfmcpp.synthetic.tracker import Tracker
from sfmcpp.synthetic.vehicle_drive import vehicle_drive

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
