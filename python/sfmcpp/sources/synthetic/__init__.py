"""Synthetic problems and drives whose truth is known: scenes, starts, outliers and sensors, all seeded.

A new one is a module with a function, and a line here.
"""

from collections.abc import Callable

from sfmcpp.model import Problem
from sfmcpp.sources.synthetic.body_motion import BodySensors, SyntheticDrive
from sfmcpp.sources.synthetic.circle_and_sphere import circle_scene, sphere_scene
from sfmcpp.sources.synthetic.corridor import corridor_scene, rig_walk_scene
from sfmcpp.sources.synthetic.disturbances import add_outliers, hide_observations, perturb
from sfmcpp.sources.synthetic.photo_collection import photo_collection_scene
from sfmcpp.sources.synthetic.street_scenes import (
    city_blocks_scene,
    drive_with_loops_scene,
    street_loop_scene,
)
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
    "drive_with_loops_scene",
    "hide_observations",
    "perturb",
    "photo_collection_scene",
    "rig_walk_scene",
    "sphere_scene",
    "street_loop_scene",
    "table_walk",
    "vehicle_drive",
]

# Each takes num_cameras, num_points, focal_px, pixel_sigma_px, camera_model, distortion and seed.
SCENES: dict[str, Callable[..., Problem]] = {
    "circle": circle_scene,
    "sphere": sphere_scene,
    "corridor": corridor_scene,
    "street-loop": street_loop_scene,
    "city-blocks": city_blocks_scene,
    "drive-with-loops": drive_with_loops_scene,
    "photo-collection": photo_collection_scene,
    "rig-walk": rig_walk_scene,
}

# Each takes length_m, frame_hz, focal_px, image_size, tracker, sensors and seed.
DRIVES: dict[str, Callable[..., SyntheticDrive]] = {
    "vehicle": vehicle_drive,
    "table-walk": table_walk,
}
