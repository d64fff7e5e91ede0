"""Data types that all other packages share: problems, camera models, trajectories, sensor streams."""

from sfmcpp.model.camera_function import CameraFunction
from sfmcpp.model.camera_models import CAMERA_MODELS, CameraModel, camera_model
from sfmcpp.model.constraints import CONSTRAINT_KINDS, ConstraintGroup, ConstraintKind, constraint_kind
from sfmcpp.model.loss_function import LossFunction
from sfmcpp.model.metadata import Metadata
from sfmcpp.model.problem import Problem
from sfmcpp.model.residual_group import ResidualGroup
from sfmcpp.model.rigs import Rigs
from sfmcpp.model.sensor_stream import Gap, SensorStream
from sfmcpp.model.trajectory import Trajectory
from sfmcpp.model.weight_selection import WeightSelection

__all__ = [
    "CAMERA_MODELS",
    "CONSTRAINT_KINDS",
    "CameraFunction",
    "CameraModel",
    "ConstraintGroup",
    "ConstraintKind",
    "Gap",
    "LossFunction",
    "Metadata",
    "Problem",
    "ResidualGroup",
    "Rigs",
    "SensorStream",
    "Trajectory",
    "WeightSelection",
    "camera_model",
    "constraint_kind",
]
