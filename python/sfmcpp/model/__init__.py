"""The data that every other package speaks: the problem, its camera models and its metadata."""

from sfmcpp.model.camera_models import CAMERA_MODELS, CameraModel, camera_model
from sfmcpp.model.problem import Metadata, Problem

__all__ = ["CAMERA_MODELS", "CameraModel", "Metadata", "Problem", "camera_model"]
