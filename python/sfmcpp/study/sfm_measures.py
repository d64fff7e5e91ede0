"""Quality measures of a model: errors of images, residual maps, tracks, intrinsics and their σ."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfmcpp.ba import residuals_px
from sfmcpp.map import Map
from sfmcpp.model import camera_model
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sfm.intrinsics_sigmas import sigmas_of_intrinsics
from sfmcpp.sources.io.colmap.camera_models import MODELS, held_by
from sfmcpp.sources.io.intrinsics import smallest_model

# Fewest observations of a cell whose mean residual says something.
_FEWEST_OF_CELL = 5

Counts = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class ResidualMap:
    """Mean residuals over the cells of an image.

    Attributes
    ----------
    size : tuple of int
        Width and height of the image [px].
    means : (rows, columns, 2) float64
        Mean of observed − projected [px]; not a number where there are too few.
    counts : (rows, columns) int64
        Observations of each cell.
    """

    size: tuple[int, int]
    means: FloatArray
    counts: Counts


class ModelMeasures:
    """Figures of one model.

    Parameters
    ----------
    world : Map
        It is not changed; figures are those of its present state.
    intrinsics_sigmas : (G, n) float64, optional
        Standard deviations of the intrinsics of its cameras, where more than the images tells them.
    """

    def __init__(self, world: Map, intrinsics_sigmas: FloatArray | None = None) -> None:
        self.world = world
        self._intrinsics_sigmas = intrinsics_sigmas
        self._local = world.whole_problem(min_views=2)

    @property
    def num_images(self) -> int:
        """Images with a pose."""
        return len(self._local.images)

    @property
    def num_points(self) -> int:
        """Points that at least two images see."""
        return len(self._local.points)

    @property
    def num_observations(self) -> int:
        """Observations of these points."""
        return len(self._local.rows)

    @cached_property
    def residuals_px(self) -> FloatArray:
        """(M, 2) observed − projected of each observation [px]."""
        if not self.num_observations:
            return np.empty((0, 2))
        return np.asarray(residuals_px(self._local.problem))

    @cached_property
    def errors_px(self) -> FloatArray:
        """(M,) distance of each observation from the image of its point [px]."""
        return np.asarray(np.linalg.norm(self.residuals_px, axis=1))

    @property
    def rms_px(self) -> float | None:
        """Root of the mean squared error [px], √2 of that of a coordinate; None without observations."""
        return float(np.sqrt(np.mean(self.errors_px**2))) if self.num_observations else None

    @property
    def mean_error_px(self) -> float | None:
        """Mean error of the observations [px]; None without any."""
        return float(self.errors_px.mean()) if self.num_observations else None

    @property
    def mean_point_error_px(self) -> float | None:
        """Mean over points of their mean errors [px], as COLMAP defines it; None without observations."""
        if not self.num_observations:
            return None
        sums = np.bincount(self._local.problem.point_index, self.errors_px, minlength=self.num_points)
        return float((sums / self.track_lengths).mean())

    @cached_property
    def observations_of_images(self) -> Counts:
        """(I,) observations of each image of the map."""
        images = self._local.images[self._local.problem.camera_index]
        return np.bincount(images, minlength=self.world.num_images)

    @cached_property
    def errors_of_images_px(self) -> FloatArray:
        """(I,) mean error of each image [px]; not a number without observations."""
        images = self._local.images[self._local.problem.camera_index]
        sums = np.bincount(images, self.errors_px, minlength=self.world.num_images)
        with np.errstate(invalid="ignore"):
            return np.asarray(sums / self.observations_of_images)

    @cached_property
    def track_lengths(self) -> Counts:
        """(N,) images that see each point."""
        return np.bincount(self._local.problem.point_index, minlength=self.num_points)

    @cached_property
    def cameras(self) -> list[int]:
        """Numbers of the cameras that took an image of the model, the most used first."""
        return _counts_by_use(self.world.image_cameras[self._local.images])

    def images_of_camera(self, camera: int) -> int:
        """Images of the model that this camera took."""
        return int(np.count_nonzero(self.world.image_cameras[self._local.images] == camera))

    def residual_map(self, cameras: list[int], columns: int = 18) -> ResidualMap | None:
        """Mean residuals over images of cameras of one size, or else what just covers the observations.

        None where nothing was observed, or pixels are counted from the middle of images of unknown size.
        """
        problem = self._local.problem
        camera = self._local.cameras[problem.intrinsics_index[problem.camera_index]]
        mine = np.isin(camera, cameras)
        if not mine.any():
            return None
        width, height = map(int, self.world.camera_sizes[cameras[0]])
        if not (width and height):
            if problem.pixels[mine].min() < 0:  # counted from the middle
                return None
            width, height = np.ceil(problem.pixels[mine].max(axis=0)).astype(int).tolist()
        rows = max(1, round(columns * height / width))
        shares = problem.pixels[mine] / (width, height)
        cell = np.clip((shares * (columns, rows)).astype(np.int64), 0, (columns - 1, rows - 1))
        place = cell[:, 1] * columns + cell[:, 0]
        counts = np.bincount(place, minlength=rows * columns)
        sums = [np.bincount(place, axis, minlength=rows * columns) for axis in self.residuals_px[mine].T]
        means = np.full((rows * columns, 2), np.nan)
        has_enough = counts >= _FEWEST_OF_CELL
        means[has_enough] = np.stack(sums, axis=1)[has_enough] / counts[has_enough, None]
        return ResidualMap((width, height), means.reshape(rows, columns, 2), counts.reshape(rows, columns))

    def intrinsics_of(self, camera: int) -> dict[str, float]:
        """Intrinsics of a camera by name."""
        names = camera_model(self.world.camera_model).intrinsics
        return dict(zip(names, self.world.intrinsics[camera].tolist(), strict=True))

    def refined(self, camera: int) -> list[str]:
        """Names of the intrinsics that adjustments may have changed."""
        names = camera_model(self.world.camera_model).intrinsics
        fixed = self.world.fixed_intrinsics[camera]
        return [name for name, held in zip(names, fixed, strict=True) if not held]

    def model_name(self, camera: int) -> str:
        """COLMAP's name of the model of a camera: its own name, or the smallest that holds it."""
        if self.world.camera_names[camera] or self.world.camera_model != "perspective":
            return self.world.camera_names[camera] or self.world.camera_model
        values, fixed = self.world.intrinsics[camera], self.world.fixed_intrinsics[camera]
        return smallest_model(held_by(MODELS), values, fixed) or self.world.camera_model

    @cached_property
    def sigmas(self) -> dict[int, dict[str, float]]:
        """Standard deviations of the free intrinsics of each camera; none for a large model."""
        local = self._local
        found = self._intrinsics_sigmas
        if found is None:
            found = sigmas_of_intrinsics(local.problem)
        if found is None:
            return {}
        names = camera_model(self.world.camera_model).intrinsics
        rows = (dict(zip(names, row, strict=True)) for row in found.tolist())
        return {
            camera: {name: row[name] for name in self.refined(camera) if row[name]}
            for camera, row in zip(local.cameras.tolist(), rows, strict=True)
        }

    def camera_dict(self, camera: int) -> dict[str, Any]:
        """Entries of a report about a camera."""
        values = self.intrinsics_of(camera)
        width, height = self.world.camera_sizes[camera].tolist()
        distortion = {name: values[name] for name in values if name[0] in "kp"}
        return {
            "id": int(self.world.camera_ids[camera]),
            "model": self.model_name(camera),
            "images": self.images_of_camera(camera),
            "width": width,
            "height": height,
            "focal_px": values["f"],
            "aspect": values.get("aspect", 1.0),
            "principal_point_px": [values.get("cx", 0.0), values.get("cy", 0.0)],
            "skew": values.get("skew", 0.0),
            "distortion": {name: value for name, value in distortion.items() if value},
            "refined": self.refined(camera),
            "sigma": self.sigmas.get(camera, {}),
        }

    def to_dict(self) -> dict[str, Any]:
        """Entries of a report about the model."""
        lengths = self.track_lengths
        values, counts = np.unique(lengths, return_counts=True)
        return {
            "images": self.num_images,
            "points": self.num_points,
            "observations": self.num_observations,
            "rms_px": self.rms_px,
            "mean_error_px": self.mean_error_px,
            "mean_point_error_px": self.mean_point_error_px,
            "mean_track_length": float(lengths.mean()) if len(lengths) else None,
            "track_lengths": dict(zip(values.tolist(), counts.tolist(), strict=True)),
            "cameras": [self.camera_dict(camera) for camera in self.cameras],
        }


def _counts_by_use(numbers: NDArray[np.integer[Any]]) -> list[int]:
    values, counts = np.unique(numbers, return_counts=True)
    return [int(value) for value in values[np.argsort(-counts, kind="stable")]]
