"""All scenes, one line each: a new scene is a module with a function and a line here."""

from __future__ import annotations

from collections.abc import Callable

from sfmcpp.model import Problem
from sfmcpp.synthetic.circle import circle_scene
from sfmcpp.synthetic.city_blocks import city_blocks_scene
from sfmcpp.synthetic.corridor import corridor_scene
from sfmcpp.synthetic.sphere import sphere_scene
from sfmcpp.synthetic.street_loop import street_loop_scene

# Each takes num_cameras, num_points, focal_px, pixel_sigma_px, camera_model, distortion and seed.
SCENES: dict[str, Callable[..., Problem]] = {
    "circle": circle_scene,
    "sphere": sphere_scene,
    "corridor": corridor_scene,
    "street-loop": street_loop_scene,
    "city-blocks": city_blocks_scene,
}
