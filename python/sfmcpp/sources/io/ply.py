"""PLY, binary little-endian, for viewers: the points in their colours and the camera centres in red."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sfmcpp.model import Problem
from sfmcpp.sources.io.atomic import atomic_files
from sfmcpp.sources.io.checks import point_colors, require_valid
from sfmcpp.sources.io.format import Format

POINT_COLOR = (255, 255, 255)
CAMERA_COLOR = (255, 0, 0)

_VERTEX = np.dtype([("position", "<f8", 3), ("color", "u1", 3)])
_PROPERTIES = [f"property double {axis}" for axis in "xyz"] + [
    f"property uchar {color}" for color in ("red", "green", "blue")
]


def write_ply(problem: Problem, path: Path, *, cameras: bool = True) -> None:
    """Write points, white unless the metadata knows their colours, then camera centres, as vertices.

    Parameters
    ----------
    problem : Problem
        It is not changed.
    path : Path
        Where to.
    cameras : bool
        Whether to write the centres, in red.

    Raises
    ------
    DatasetError
        If a coordinate is not finite, or the file cannot be written.
    """
    require_valid(problem, path)
    centres = problem.centres if cameras else np.empty((0, 3))
    vertices = np.empty(problem.num_points + len(centres), dtype=_VERTEX)
    vertices["position"] = np.concatenate([problem.points, centres])
    vertices["color"][: problem.num_points] = point_colors(problem, POINT_COLOR, path)
    vertices["color"][problem.num_points :] = CAMERA_COLOR
    with atomic_files(path) as (stream,):
        stream.write(_header(len(vertices)).encode("ascii"))
        stream.write(vertices.tobytes())


def _header(count: int) -> str:
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {count}", *_PROPERTIES, "end_header"]
    return "\n".join(lines) + "\n"


FORMAT = Format(
    "ply",
    "PLY, binary: points and camera centres, for viewers",
    (".ply",),
    None,
    write_ply,
    lacks=(
        "origin of the world",
        "observations",
        "keypoints without a point",
        "rotations and intrinsics",
        "image names",
        "image sizes",
        "masks",
        "rigid frames",
        "uncertainties of observations",
    ),
)
