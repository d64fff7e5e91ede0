"""Bundle adjustment, structure from motion and multi-sensor SLAM: a Python package with a C++ core."""

from sfmcpp._core import __version__
from sfmcpp.ba import Iteration, SolveOptions, Summary, check, check_jacobians, cost, residuals, solve
from sfmcpp.errors import DatasetError, InvalidArgument, SfmcppError
from sfmcpp.io import convert, formats, read, write
from sfmcpp.model import CAMERA_MODELS, CameraModel, Metadata, Problem
from sfmcpp.synthetic import circle_scene, perturb

__all__ = [
    "CAMERA_MODELS",
    "CameraModel",
    "DatasetError",
    "InvalidArgument",
    "Iteration",
    "Metadata",
    "Problem",
    "SfmcppError",
    "SolveOptions",
    "Summary",
    "__version__",
    "check",
    "check_jacobians",
    "circle_scene",
    "convert",
    "cost",
    "formats",
    "perturb",
    "read",
    "residuals",
    "solve",
    "write",
]
