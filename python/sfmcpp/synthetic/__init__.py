"""Synthetic problems whose truth is known: scenes and perturbed starts, all seeded."""

from sfmcpp.synthetic.circle import circle_scene
from sfmcpp.synthetic.perturbation import perturb

__all__ = ["circle_scene", "perturb"]
