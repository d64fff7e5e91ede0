"""Synthetic problems whose truth is known: scenes, perturbed starts and outliers, all seeded."""

from sfmcpp.synthetic.circle import circle_scene
from sfmcpp.synthetic.city_blocks import city_blocks_scene
from sfmcpp.synthetic.corridor import corridor_scene
from sfmcpp.synthetic.outliers import add_outliers
from sfmcpp.synthetic.perturbation import perturb
from sfmcpp.synthetic.registry import SCENES
from sfmcpp.synthetic.sphere import sphere_scene
from sfmcpp.synthetic.street_loop import street_loop_scene

__all__ = [
    "SCENES",
    "add_outliers",
    "circle_scene",
    "city_blocks_scene",
    "corridor_scene",
    "perturb",
    "sphere_scene",
    "street_loop_scene",
]
