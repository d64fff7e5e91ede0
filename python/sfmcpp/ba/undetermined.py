"""Which camera nothing determines: names for failures of a linear model that tell a column, or none."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import wraps
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numpy as np

from sfmcpp.errors import InvalidArgument

if TYPE_CHECKING:
    from sfmcpp.ba.linearize import LinearModel

Method = TypeVar("Method", bound=Callable[..., Any])
_COLUMN = re.compile(r"column (\d+) of a camera: ")
_SINGULAR = "normal equations are singular"
# Least eigenvalue of a block with a unit diagonal that is more than rounding.
_RANK_TOLERANCE = 1e-12
_MOST_NAMED = 8


def naming_cameras(method: Method) -> Method:
    """Let a method of a linear model name the cameras that are meant where it fails."""

    @wraps(method)
    def call(self: LinearModel, *arguments: Any, **named: Any) -> Any:
        try:
            return method(self, *arguments, **named)
        except InvalidArgument as error:
            raise InvalidArgument(_with_cameras(str(error), self)) from error

    return cast(Method, call)


def _with_cameras(text: str, model: LinearModel) -> str:
    column = _COLUMN.match(text)
    if column is not None:
        camera, parameter = np.argwhere(model.camera_columns == int(column[1]))[0].tolist()
        return f"camera {camera}, {model.parameter_names[parameter]}: {text[column.end() :]}"
    if _SINGULAR in text and (weak := _undetermined(model)):
        shown = ", ".join(map(str, weak[:_MOST_NAMED])) + ", …" * (len(weak) > _MOST_NAMED)
        number = "cameras" if len(weak) > 1 else "camera"
        return f"{text}; {number} {shown} would be undetermined even if all points were known"
    return text


def _undetermined(model: LinearModel) -> list[int]:
    """Cameras whose own block of the normal matrix, the points given, is singular."""
    normal = model.normal_matrix()
    found = []
    for camera, columns in enumerate(model.camera_columns):
        own = columns[columns >= 0]
        block = normal[own][:, own].toarray()
        diagonal = np.diagonal(block)
        if len(own) and (diagonal.min() <= 0 or _least(block, diagonal) < _RANK_TOLERANCE):
            found.append(camera)
    return found


def _least(block: np.ndarray, diagonal: np.ndarray) -> float:
    scale = 1 / np.sqrt(diagonal)
    return float(np.linalg.eigvalsh(scale[:, None] * block * scale)[0])
