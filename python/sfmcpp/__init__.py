"""Bundle adjustment, structure from motion and multi-sensor SLAM: a Python package with a C++ core."""

from sfmcpp._core import __version__
from sfmcpp.ba import (
    Covariance,
    Iteration,
    LinearModel,
    SolveOptions,
    Summary,
    as_projective,
    check,
    check_jacobians,
    cost,
    linearize,
    projection_matrices,
    projective_problem,
    residuals,
)
from sfmcpp.doctor import Diagnosis, Finding, diagnose
from sfmcpp.errors import DatasetError, InvalidArgument, SfmcppError
from sfmcpp.model import CAMERA_MODELS, CONSTRAINT_KINDS, CameraModel, ConstraintGroup, Metadata, Problem
from sfmcpp.sources.io import convert, formats, read, write
from sfmcpp.sources.synthetic import (
    SCENES,
    add_outliers,
    circle_scene,
    city_blocks_scene,
    corridor_scene,
    drive_with_loops_scene,
    perturb,
    photo_collection_scene,
    sphere_scene,
    street_loop_scene,
)
from sfmcpp.weighting import solve

__all__ = [
    "CAMERA_MODELS",
    "CONSTRAINT_KINDS",
    "SCENES",
    "CameraModel",
    "ConstraintGroup",
    "Covariance",
    "DatasetError",
    "Diagnosis",
    "Finding",
    "InvalidArgument",
    "Iteration",
    "LinearModel",
    "Metadata",
    "Problem",
    "SfmcppError",
    "SolveOptions",
    "Summary",
    "__version__",
    "add_outliers",
    "as_projective",
    "check",
    "check_jacobians",
    "circle_scene",
    "city_blocks_scene",
    "convert",
    "corridor_scene",
    "cost",
    "diagnose",
    "drive_with_loops_scene",
    "formats",
    "linearize",
    "perturb",
    "photo_collection_scene",
    "projection_matrices",
    "projective_problem",
    "read",
    "residuals",
    "solve",
    "sphere_scene",
    "street_loop_scene",
    "write",
]
