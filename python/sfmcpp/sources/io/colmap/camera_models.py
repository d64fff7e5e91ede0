"""COLMAP's camera models and ours, both ways: the perspective one, and that of fisheye lenses."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from sfmcpp.model import Problem
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.model.camera_models import PERSPECTIVE
from sfmcpp.sources.io.colmap.fisheye import is_fisheye
from sfmcpp.sources.io.intrinsics import fixed_but, perspective_columns, perspective_rows

# What FULL_OPENCV divides its radial factor 1 + k1 r² + k2 r⁴ + k3 r⁶ by, after COLMAP's names: 1 + k4 r² + …
# The perspective model has other k4 and k5, of r⁸ and r¹⁰, and no divisor.
_DIVISOR = ("divisor k4", "divisor k5", "divisor k6")


@dataclass(frozen=True)
class ColmapModel:
    """A camera model of COLMAP that the perspective model covers, or :data:`fisheye.FISHEYE`.

    Both of these call the same parameters by the same names; what else it has must be zero.
    """

    number: int
    params: tuple[str, ...]
    distortion: tuple[str, ...]

    @property
    def has_aspect(self) -> bool:
        """Whether both focal lengths are parameters."""
        return "fy" in self.params

    @property
    def free(self) -> tuple[str, ...]:
        """Perspective parameters that are free after reading: all that it has but the principal point."""
        return ("f", *(("aspect",) if self.has_aspect else ()), *self.distortion)

    @property
    def kept(self) -> tuple[str, ...]:
        """Perspective parameters that it can hold."""
        return (*self.free, "cx", "cy")


MODELS = {
    "SIMPLE_PINHOLE": ColmapModel(0, ("f", "cx", "cy"), ()),
    "PINHOLE": ColmapModel(1, ("f", "fy", "cx", "cy"), ()),
    "SIMPLE_RADIAL": ColmapModel(2, ("f", "cx", "cy", "k1"), ("k1",)),
    "RADIAL": ColmapModel(3, ("f", "cx", "cy", "k1", "k2"), ("k1", "k2")),
    "OPENCV": ColmapModel(4, ("f", "fy", "cx", "cy", "k1", "k2", "p1", "p2"), ("k1", "k2", "p1", "p2")),
    "FULL_OPENCV": ColmapModel(
        6,
        ("f", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", *_DIVISOR),
        ("k1", "k2", "p1", "p2", "k3"),
    ),
}
FISHEYE_MODELS = {
    "SIMPLE_RADIAL_FISHEYE": ColmapModel(8, ("f", "cx", "cy", "k1"), ("k1",)),
    "RADIAL_FISHEYE": ColmapModel(9, ("f", "cx", "cy", "k1", "k2"), ("k1", "k2")),
    "OPENCV_FISHEYE": ColmapModel(
        5, ("f", "fy", "cx", "cy", "k1", "k2", "k3", "k4"), ("k1", "k2", "k3", "k4")
    ),
    # Of COLMAP 4, so never chosen for cameras that are not of it.
    "SIMPLE_FISHEYE": ColmapModel(14, ("f", "cx", "cy"), ()),
    "FISHEYE": ColmapModel(15, ("f", "fy", "cx", "cy"), ()),
}
READ_MODELS = MODELS | FISHEYE_MODELS
NAME_OF_NUMBER = {model.number: name for name, model in READ_MODELS.items()}
_UNSUPPORTED_NAMES = {
    7: "FOV",
    10: "THIN_PRISM_FISHEYE",
    11: "RAD_TAN_THIN_PRISM_FISHEYE",
    12: "SIMPLE_DIVISION",
    13: "DIVISION",
    16: "EUCM",
    17: "EQUIRECTANGULAR",
}
_UNDISTORTED = set(_UNSUPPORTED_NAMES.values()) - {"EQUIRECTANGULAR"}


def unsupported(model: str | int, supported: Iterable[str] = READ_MODELS) -> str:
    """Reason for refusing a camera model given by name or number, and what helps in files of models."""
    name = (NAME_OF_NUMBER | _UNSUPPORTED_NAMES).get(model, str(model)) if isinstance(model, int) else model
    helps = supported is READ_MODELS and name in _UNDISTORTED
    remedy = "; COLMAP's image_undistorter makes a PINHOLE model of it" if helps else ""
    return f"camera model {name} is not supported: must be one of {', '.join(supported)}{remedy}"


def has_divisor(model: str, params: list[float]) -> bool:
    """Whether the radial factor of a camera is a fraction, which the perspective model cannot hold."""
    named = dict(zip(READ_MODELS[model].params, params, strict=True))
    return any(named.get(name, 0.0) != 0.0 for name in _DIVISOR)


DIVISOR_RULE = (
    "FULL_OPENCV divides by 1 + k4 r² + k5 r⁴ + k6 r⁶: k4, k5 and k6 must be 0; COLMAP's image_undistorter "
    "makes a PINHOLE model of it"
)


def models_of(problem: Problem) -> Mapping[str, ColmapModel]:
    """Models that may hold the cameras of a problem, the smallest first."""
    return FISHEYE_MODELS if is_fisheye(problem) else MODELS


def held_by(models: Mapping[str, ColmapModel]) -> dict[str, tuple[str, ...]]:
    """Parameters that each of these models can hold."""
    return {name: model.kept for name, model in models.items()}


def intrinsics_from_params(models: list[str], params: list[list[float]]) -> tuple[FloatArray, BoolArray]:
    """Intrinsics (G, K) in the order of the perspective model, and which of them stay fixed."""
    values, fixed = perspective_rows(len(models)), fixed_but(len(models))
    for name in dict.fromkeys(models):
        model, rows = READ_MODELS[name], [row for row, other in enumerate(models) if other == name]
        numbers = np.array([params[row] for row in rows]).T
        named = dict(zip(model.params, numbers, strict=True))
        if model.has_aspect:
            named["aspect"] = named.pop("fy") / named["f"]
        for param in named.keys() - _DIVISOR:
            values[rows, PERSPECTIVE.index(param)] = named[param]
        fixed[np.ix_(rows, perspective_columns(*model.free))] = False
    return values, fixed


def params_from_intrinsics(name: str, values: FloatArray) -> list[float]:
    """Parameters of that COLMAP model for one row of perspective intrinsics."""
    named = dict(zip(PERSPECTIVE, values.tolist(), strict=True))
    named |= {"fy": named["f"] * named["aspect"], **dict.fromkeys(_DIVISOR, 0.0)}
    return [named[param] for param in READ_MODELS[name].params]
