"""Covariance files: standard deviations as a table, or covariances as arrays."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sfmcpp.ba import LinearModel
from sfmcpp.errors import DatasetError
from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sources.io.atomic import atomic_files

COVARIANCE_SUFFIXES = (".csv", ".npz")
# Free parameters of cameras: n³/3 operations of n that all meet, minutes of one processor; seconds elsewhere.
MOST_COLUMNS = 20_000
# Points times these parameters: some ten seconds of one processor, more where each point is a solve.
MOST_PRODUCTS = 20_000_000


@dataclass(frozen=True, eq=False)
class Covariances:
    """Covariances of all cameras and points of a problem, for observations whose σ is exact.

    Attributes
    ----------
    problem : Problem
        What they are of.
    parameter_names : tuple of str
        What the D parameters of a camera are.
    cameras : (C, D, D) float64
        Of each camera; not a number for parameters that were not estimated.
    points : (N, 3, 3) float64
        Of each point; likewise, and for all where they are too many.
    freedoms : int
        Freedoms of the world that nothing holds: the covariances are those of the free network then.
    variance_factor : float
        That of the model: what to multiply by where the σ of the observations are a guess; not a number
        without redundancy.
    """

    problem: Problem
    parameter_names: tuple[str, ...]
    cameras: FloatArray
    points: FloatArray
    freedoms: int
    variance_factor: float

    @classmethod
    def of(cls, problem: Problem, model: LinearModel) -> Covariances:
        """Of the linear model of a problem.

        Raises
        ------
        InvalidArgument
            As :meth:`sfmcpp.LinearModel.covariance`.
        """
        few = problem.num_points * model.num_camera_columns <= MOST_PRODUCTS
        found = model.covariance(cameras="all", points="all" if few else ())
        found.cameras[_mask_of_missing(model.camera_columns < 0)] = np.nan
        points = found.points if few else np.full((problem.num_points, 3, 3), np.nan)
        points[model.point_columns < 0] = np.nan
        freedoms = model.num_columns - model.num_determined
        factor = model.variance_factor
        return cls(problem, model.parameter_names, found.cameras, points, freedoms, factor)

    @property
    def has_points(self) -> bool:
        """Whether those of any point were computed."""
        return bool(np.isfinite(self.points).any())

    @property
    def gauge(self) -> str:
        """Gauge of the covariances."""
        if self.freedoms == 0:
            return "the frame that fixed parameters or positions give"
        return f"the mean of all cameras, as {self.freedoms} gauge freedoms are left"

    def to_dict(self) -> dict[str, Any]:
        """Entries of a report."""
        factor = None if np.isnan(self.variance_factor) else self.variance_factor
        return {"refer_to": self.gauge, "free_freedoms": self.freedoms, "variance_factor": factor}


def write_covariances(path: Path, found: Covariances) -> None:
    """Write standard deviations to ``.csv``, a line for each camera and point, or all blocks to ``.npz``.

    Centres and points are in units of the world, rotations, about the axes of the camera, in degrees in the
    table and in radians in the arrays, intrinsics in their own. What was not estimated has an empty cell, or
    is not a number.

    Raises
    ------
    DatasetError
        If the file cannot be written.
    """
    require_covariance_format(path)
    with atomic_files(path) as (file,):
        file.write(_npz(found) if path.suffix.lower() == ".npz" else _csv(found).encode())


def require_covariance_format(path: Path) -> None:
    """Raise a DatasetError unless the name of a file has a suffix of a covariance format."""
    if path.suffix.lower() not in COVARIANCE_SUFFIXES:
        raise DatasetError(
            path, f"the name of a file of covariances must end in {', '.join(COVARIANCE_SUFFIXES)}"
        )


def require_covariances(problem: Problem, path: Path) -> None:
    """Raise a DatasetError if a problem has no covariances, or they would take longer than its solve."""
    if not problem.is_metric:
        raise DatasetError(path, f"{problem.camera_model} cameras have no covariances")
    moving = 6 * np.count_nonzero(~problem.fixed_cameras)
    columns = int(moving + np.count_nonzero(~problem.fixed_intrinsics))
    if columns > MOST_COLUMNS:
        advice = "in Python, linearize(problem).covariance(cameras=[…]) gives those of some"
        reason = f"covariances of {columns:,} free parameters of cameras: must be at most {MOST_COLUMNS:,}"
        raise DatasetError(path, f"{reason}; {advice}")


def _mask_of_missing(missing: Any) -> Any:
    """(C, D, D) mask of the entries that belong to a parameter that is missing (C, D)."""
    return missing[:, :, None] | missing[:, None, :]


def _npz(found: Covariances) -> bytes:
    content = io.BytesIO()
    np.savez(
        content,
        parameter_names=np.array(found.parameter_names),
        cameras=found.cameras,
        points=found.points,
        variance_factor=found.variance_factor,
        free_freedoms=found.freedoms,
    )
    return content.getvalue()


def _csv(found: Covariances) -> str:
    titles = [_column_title(name) for name in found.parameter_names]
    degrees = np.array([np.rad2deg(1.0) if title.endswith("_deg") else 1.0 for title in titles])
    # Places first: a point has these alone.
    order = [3, 4, 5, 0, 1, 2, *range(6, len(titles))]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["kind", "index", "name", *(titles[k] for k in order)])
    names = found.problem.metadata.names(found.problem.num_cameras)
    for k, sigmas in enumerate((_sigmas(found.cameras) * degrees)[:, order].tolist()):
        writer.writerow(["camera", k, names[k], *map(_cell, sigmas)])
    for k, sigmas in enumerate(_sigmas(found.points).tolist() if found.has_points else ()):
        writer.writerow(["point", k, "", *map(_cell, sigmas), *[""] * (len(order) - 3)])
    return text.getvalue()


def _sigmas(blocks: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(np.diagonal(blocks, axis1=1, axis2=2)))


def _column_title(name: str) -> str:
    """Column of a parameter: ``sigma_rx_deg`` of "rotation x", ``sigma_sensor_y`` of "sensor centre y"."""
    of_sensor, own = "sensor_" * name.startswith("sensor "), name.removeprefix("sensor ")
    if own.startswith("rotation "):
        return f"sigma_{of_sensor}r{own[-1]}_deg"
    return f"sigma_{of_sensor}{own.removeprefix('centre ')}"


def _cell(value: float) -> str:
    return "" if np.isnan(value) else f"{value:.6g}"
