"""Result of a reconstruction: models, and the outcome of each image and pair."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from sfmcpp.errors import InvalidArgument
from sfmcpp.map import Map, problem_of_map
from sfmcpp.model import Problem
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.metadata import WorldOrigin
from sfmcpp.sfm.match_graph import MatchGraph


@dataclass(frozen=True)
class ImageOutcome:
    """Outcome of one image.

    Attributes
    ----------
    registered : bool
        Whether it has a pose in a model.
    model : int or None
        Number of the model, 0 the largest.
    reason : str
        Why it has none, in a sentence; empty if it has one.
    """

    registered: bool
    model: int | None = None
    reason: str = ""


@dataclass(frozen=True, eq=False, repr=False)
class GpsOutcome:
    """How the first model was brought into the world by positions of its images.

    Attributes
    ----------
    sigma_m : float
        Standard deviation of one coordinate of a position, as the data tell it [m].
    accuracy_m : float
        Stated accuracy of the model in the world: standard deviation of one coordinate of its centres, RMS
        over the images [m].
    outliers : list of str
        Images whose position is an outlier.
    origin : (3,) float64
        Of the model: latitude, longitude [deg, WGS84] and height [m], with axes east, north, up; or x, y, z
        in the frame of the positions [m], with its axes.
    residuals_m : dict
        Distance of each image's centre from its position, by name [m].
    offsets_m : dict
        The same along the axes (3,), centre minus position, by name [m].
    geodetic : bool
        Whether the origin is latitude, longitude and height.
    stated_sigma_m : float or None
        Where positions came with standard deviations: their median [m], beside which `sigma_m` is what it
        turned out to be. The others are right or wrong by the same factor.
    sigmas_m : dict
        Standard deviations (3,) of the centre of each image that sees points along the axes of the world, by
        name [m]; of many images, of 300 all along.
    warnings : list of str
        What may be wrong with the positions as a whole, in sentences.
    intrinsics_sigmas : (G, n) float64 or None
        Standard deviations of the intrinsics in the adjustment with the positions, in their units; 0 for
        those that are held.
    without_position : list of str
        Images of the model that have none.
    """

    sigma_m: float
    accuracy_m: float
    outliers: list[str]
    origin: FloatArray
    residuals_m: dict[str, float]
    geodetic: bool = True
    stated_sigma_m: float | None = None
    sigmas_m: dict[str, FloatArray] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    intrinsics_sigmas: FloatArray | None = None
    offsets_m: dict[str, FloatArray] = field(default_factory=dict)
    without_position: list[str] = field(default_factory=list)

    def __repr__(self) -> str:
        accuracy = f"σ {self.sigma_m:.3g} m, the model within {self.accuracy_m:.3g} m"
        out = f"left out {', '.join(self.outliers) or 'none'} of {len(self.residuals_m)}"
        origin = ", ".join(f"{name} {value:.10g}" for name, value in self.world_origin.to_dict().items())
        return f"GpsOutcome({accuracy}; {out}; origin {origin})"

    @property
    def world_origin(self) -> WorldOrigin:
        """The origin, as problems keep it."""
        return WorldOrigin(self.origin, self.geodetic)

    def to_dict(self) -> dict[str, Any]:
        """As plain values for a report."""
        known = {name: value for name, value in vars(self).items() if name != "intrinsics_sigmas"}
        by_axis = {
            name: {image: value.tolist() for image, value in known[name].items()}
            for name in ("sigmas_m", "offsets_m")
        }
        return known | by_axis | {"origin": self.world_origin.to_dict(), "rms_m": self.rms_m}

    def moved(self, names: Sequence[str], by: FloatArray) -> GpsOutcome:
        """The outcome of a model that a further solve has moved: residuals and offsets follow, no more.

        Parameters
        ----------
        names : sequence of str
            Of the n images of the model.
        by : (n, 3) float64
            How far their centres have moved since, in the frame of the model [m].
        """
        steps = dict(zip(names, by, strict=True))
        offsets = {name: offset + steps[name] for name, offset in self.offsets_m.items()}
        distances = {name: float(np.linalg.norm(offset)) for name, offset in offsets.items()}
        return replace(self, offsets_m=offsets, residuals_m=distances)

    @property
    def rms_m(self) -> list[float] | None:
        """Root mean squares of the offsets along the axes, of positions that were not left out [m]."""
        used = [offset for name, offset in self.offsets_m.items() if name not in self.outliers]
        return np.sqrt(np.mean(np.square(used), axis=0)).tolist() if used else None


@dataclass(eq=False)
class SfmRun:
    """A reconstruction that has ended; :meth:`problem` makes a model a :class:`Problem`.

    Attributes
    ----------
    source : str
        What was reconstructed: a path, or a word for arrays.
    options : dict
        How it was asked for.
    graph : MatchGraph
        Images, features and pairs. Image and keypoint numbers of a model are those of the graph.
    models : list of Map
        The largest first. Each has all images and keypoints of the graph; those outside it have no pose.
    images : dict
        Outcome of each image by name, also of files that could not be read.
    seconds : dict
        Wall time of each stage by name [s]: ``features``, ``matching``, ``mapping`` …
    warnings : list of str
        What a user should know, in sentences.
    gps : GpsOutcome or None
        None where no positions were used.
    interrupted : bool
        Whether it was ended before its time.
    gps_failure : str
        Why the models are not in the world of the positions that were asked for; empty if one is, or none
        were.
    """

    source: str
    options: dict[str, Any]
    graph: MatchGraph
    models: list[Map]
    images: dict[str, ImageOutcome]
    seconds: dict[str, float] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    gps: GpsOutcome | None = None
    interrupted: bool = False
    gps_failure: str = ""

    made_into: ClassVar[dict[str, str]] = {"Problem": "its method problem()"}

    def __repr__(self) -> str:
        found = ", ".join(repr(model) for model in self.models) or "no model"
        return f"SfmRun({self.source!r}: {len(self.images)} images, {found})"

    @property
    def model(self) -> Map | None:
        """The largest model, or None."""
        return self.models[0] if self.models else None

    @checked()
    def problem(self, model: int = 0) -> Problem:
        """One of the models as a problem, to be solved, examined or written in any format.

        Parameters
        ----------
        model : int
            Which, 0 the largest.

        Returns
        -------
        Problem
            A copy: images with a pose and points with a position, with names, colours and all keypoints, and
            the origin of the world where positions told it, in the metadata.

        Raises
        ------
        InvalidArgument
            If there is no such model.
        """
        if not 0 <= model < len(self.models):
            raise InvalidArgument(f"model = {model!r}: the run has {len(self.models)} models")
        problem = problem_of_map(self.models[model])
        if model == 0 and self.gps is not None:
            self.gps.world_origin.put_into(problem.metadata)
        return problem

    @property
    def num_registered(self) -> int:
        """Images with a pose in the largest model."""
        return int(np.count_nonzero(self.models[0].registered)) if self.models else 0
