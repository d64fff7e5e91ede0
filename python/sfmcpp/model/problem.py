"""The bundle adjustment problem as a structure of NumPy arrays."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp.errors import InvalidArgument
from sfmcpp.model import selection
from sfmcpp.model.arrays import (
    BoolArray,
    FloatArray,
    IndexArray,
    for_each,
    typed_array,
)
from sfmcpp.model.camera_function import CameraFunction
from sfmcpp.model.camera_models import OTHER_NAMES, CameraModel, camera_model
from sfmcpp.model.metadata import Metadata, some_metadata
from sfmcpp.model.named_fields import NamedFields
from sfmcpp.model.names import CameraModelName
from sfmcpp.model.rigs import Rigs
from sfmcpp.model.uncertainty import Uncertainty, require_one_uncertainty


@dataclass(eq=False)
class Problem(NamedFields):
    """A bundle adjustment problem: C cameras, G rows of intrinsics, N points, M observations.

    C-contiguous arrays of the right dtype are used without copying (others are copied), and a solve changes
    `cameras`, `intrinsics` and `points` in place when it ends, visibly to the caller and to other problems
    with the same arrays; a callback sees those of the start. :meth:`copy` and all ``with_…`` methods return
    independent problems with the same metadata; ``Problem(…)`` has only the metadata passed to it.

    Parameters
    ----------
    camera_model : str or CameraFunction
        ``"calibrated"``, ``"perspective"``, ``"bal"`` or ``"projective"``, see :class:`CameraModel`; or a
        Python function.
    cameras : (C, 3, 4) float64
        ``[R | c]`` of each camera: rotation world_from_camera and centre in the world. A world point X
        is at ``Rᵀ (X − c)`` in the camera, z forward, y down. Projective cameras: the matrix P.
    intrinsics : (G, K) float64
        Intrinsic parameters in the order of the camera model. One row per camera, or fewer rows shared
        through `intrinsics_index`.
    points : (N, 3) float64
        World points; (N, 4), homogeneous, for projective cameras.
    camera_index, point_index : (M,) int32
        Camera and point of each observation.
    pixels : (M, 2) float64
        Observed image positions [px].
    intrinsics_index : (C,) int32, optional
        Row of `intrinsics` that each camera uses. Default: camera i uses row i (then G = C).
    sigma_px : (M,) float64, optional
        Standard deviation of each observation [px], or one number for all. Default: 1 px everywhere.
    covariance_px2 : (M, 2, 2) float64, optional
        Covariance of each observation [px²], or one (2, 2) for all, in place of `sigma_px`. Residuals are
        then ``L (observed − projected)`` with ``LᵀL = Σ⁻¹``, L lower triangular (thesis eq. 1.18).
    fixed_cameras : (C,) bool, optional
        Cameras with fixed pose. Default: none.
    fixed_points : (N,) bool, optional
        Fixed points. Default: none.
    fixed_intrinsics : (G, K) bool, optional
        Fixed single intrinsic parameters. Default: as the camera model defines.
    rigs : Rigs, optional
        Which cameras are mounted rigidly together; a solve then moves their frames. Cameras of one frame are
        fixed all together or not at all. Default: cameras move independently.
    metadata : Metadata, optional
        Names, colours and the like; ignored by solvers.

    Raises
    ------
    InvalidArgument
        If a shape or a dtype is wrong, or both `sigma_px` and `covariance_px2` are given. Values (indices in
        range, finite numbers, rotations) are checked by :func:`sfmcpp.check` and by every solve.
    """

    camera_model: CameraModelName | str | CameraFunction
    cameras: FloatArray
    intrinsics: FloatArray
    points: FloatArray
    camera_index: IndexArray
    point_index: IndexArray
    pixels: FloatArray
    intrinsics_index: IndexArray = None  # type: ignore[assignment]
    sigma_px: FloatArray | None = None
    covariance_px2: FloatArray | None = None
    fixed_cameras: BoolArray = None  # type: ignore[assignment]
    fixed_points: BoolArray = None  # type: ignore[assignment]
    fixed_intrinsics: BoolArray = None  # type: ignore[assignment]
    rigs: Rigs | None = None
    metadata: Metadata = field(default_factory=Metadata)

    if TYPE_CHECKING:  # what is given need not be what is held

        def __init__(
            self,
            camera_model: CameraModelName | str | CameraFunction,
            cameras: ArrayLike,
            intrinsics: ArrayLike,
            points: ArrayLike,
            camera_index: ArrayLike,
            point_index: ArrayLike,
            pixels: ArrayLike,
            intrinsics_index: ArrayLike | None = None,
            sigma_px: ArrayLike | None = None,
            covariance_px2: ArrayLike | None = None,
            fixed_cameras: ArrayLike | None = None,
            fixed_points: ArrayLike | None = None,
            fixed_intrinsics: ArrayLike | None = None,
            rigs: Rigs | None = None,
            metadata: Metadata | None = None,
        ) -> None: ...

    def __post_init__(self) -> None:
        model = camera_model(self.camera_model)
        self.cameras = typed_array("cameras", self.cameras, np.float64, (-1, 3, 4))
        self.intrinsics = _rows_of_intrinsics(self.intrinsics, model.intrinsics)
        self.points = typed_array("points", self.points, np.float64, (-1, model.point_size))
        self.camera_index = typed_array("camera_index", self.camera_index, np.int32, (-1,))
        count = self.num_observations
        self.point_index = typed_array("point_index", self.point_index, np.int32, (count,))
        self.pixels = typed_array("pixels", self.pixels, np.float64, (count, 2))
        if self.sigma_px is not None:
            self.sigma_px = for_each("sigma_px", self.sigma_px, count)
        if self.covariance_px2 is not None:
            self.covariance_px2 = for_each("covariance_px2", self.covariance_px2, count, (2, 2))
            require_one_uncertainty(self.sigma_px, self.covariance_px2)
        if self.rigs is not None:
            _require_fitting_rigs(self.rigs, self.num_cameras)
        self.metadata = some_metadata(self.metadata)
        self._set_defaults(model.intrinsics, model.free_by_default)

    def _set_defaults(self, names: Sequence[str], free: Iterable[str]) -> None:
        cameras, groups, points = self.num_cameras, len(self.intrinsics), self.num_points
        if self.intrinsics_index is None:
            _require_private_intrinsics(groups, cameras)
            self.intrinsics_index = np.arange(cameras, dtype=np.int32)
        if self.fixed_cameras is None:
            self.fixed_cameras = np.zeros(cameras, dtype=np.bool_)
        if self.fixed_points is None:
            self.fixed_points = np.zeros(points, dtype=np.bool_)
        if self.fixed_intrinsics is None:
            free = set(free)
            self.fixed_intrinsics = np.tile([name not in free for name in names], (groups, 1))
        self.intrinsics_index = typed_array("intrinsics_index", self.intrinsics_index, np.int32, (cameras,))
        self.fixed_cameras = typed_array("fixed_cameras", self.fixed_cameras, np.bool_, (cameras,))
        self.fixed_points = typed_array("fixed_points", self.fixed_points, np.bool_, (points,))
        self.fixed_intrinsics = typed_array(
            "fixed_intrinsics", self.fixed_intrinsics, np.bool_, (groups, len(names))
        )

    @property
    def _model(self) -> CameraModel | CameraFunction:
        return camera_model(self.camera_model)

    @property
    def num_cameras(self) -> int:
        """Number of cameras, C."""
        return len(self.cameras)

    @property
    def num_points(self) -> int:
        """Number of points, N."""
        return len(self.points)

    @property
    def num_observations(self) -> int:
        """Number of observations, M."""
        return len(self.camera_index)

    @property
    def rotations(self) -> FloatArray:
        """(C, 3, 3) view: rotation world_from_camera of each camera."""
        return self.cameras[:, :, :3]

    @property
    def centres(self) -> FloatArray:
        """(C, 3) view: centre of each camera in the world."""
        return self.cameras[:, :, 3]

    @property
    def uncertainty(self) -> Uncertainty:
        """Standard deviations or covariances of the observations, or neither."""
        return Uncertainty(self.sigma_px, self.covariance_px2)

    @property
    def intrinsic_names(self) -> tuple[str, ...]:
        """Names of the columns of `intrinsics`."""
        return self._model.intrinsics

    @property
    def is_metric(self) -> bool:
        """Whether the cameras are Euclidean poses, not projection matrices."""
        return self._model.metric

    def set_free_intrinsics(self, *names: str) -> Problem:
        """Free exactly the named intrinsic parameters, in every row; fix the others. Returns `self`.

        Raises
        ------
        InvalidArgument
            If the camera model has no parameter of that name, or fixes all its intrinsics.
        """
        known = self.intrinsic_names
        for name in names:
            if not isinstance(name, str):
                raise InvalidArgument(f"names = {name!r}: must be names one by one, or none to fix all")
            if name not in known:
                other = OTHER_NAMES.get(name)
                hint = f"; {name} of other programs is {other}" if other in known else ""
                raise InvalidArgument(
                    f"intrinsic {name!r}: camera model {self._model.name!r} has {', '.join(known)}{hint}"
                )
        if names and not self._model.can_be_free:
            raise InvalidArgument(
                f"intrinsic {names[0]!r}: camera model {self._model.name!r} keeps all its intrinsics fixed; "
                "use 'perspective'"
            )
        self.fixed_intrinsics[:] = [name not in names for name in known]
        return self

    def with_observations(self, chosen: ArrayLike) -> Problem:
        """Copy with some of the observations, and all cameras, intrinsics and points.

        Parameters
        ----------
        chosen : (m,) int or (M,) bool
            Which observations, by number or as a mask.

        Returns
        -------
        Problem
            With standard deviations, covariances and metadata of these. The others stay keypoints that see no
            point, where the metadata number keypoints.

        Raises
        ------
        InvalidArgument
            If a number is out of range, or a mask has another length.
        """
        return selection.of_observations(self, chosen)

    def with_points(self, chosen: ArrayLike) -> Problem:
        """Copy with some of the points and their observations, and all cameras and intrinsics.

        Parameters
        ----------
        chosen : (n,) int or (N,) bool
            Which points, by number, each once, or as a mask; they are numbered anew in this order.

        Returns
        -------
        Problem
            With metadata of these.

        Raises
        ------
        InvalidArgument
            If a number is out of range or there twice, or a mask has another length.
        """
        return selection.of_points(self, chosen)

    def with_cameras(self, chosen: ArrayLike) -> Problem:
        """Copy with some of the cameras and their observations, and all points, seen or not.

        Parameters
        ----------
        chosen : (c,) int, (C,) bool or (c,) str
            Which cameras, by number or name of their image, each once, or as a mask; they are numbered anew
            in this order.

        Returns
        -------
        Problem
            With metadata of these, and the rows of intrinsics, rigid frames and sensors that they use.

        Raises
        ------
        InvalidArgument
            If a name is unknown or that of several images, a number is out of range or there twice, or a mask
            has another length.
        """
        return selection.of_cameras(self, chosen)

    def with_shared_intrinsics(self, groups: ArrayLike | None = None) -> Problem:
        """Copy in which cameras share intrinsics, like photos of one camera at one zoom.

        Parameters
        ----------
        groups : (C,) int, optional
            Cameras of the same number share one row, which starts as that of the first of them, in values and
            in what is fixed. Default: all share one.

        Returns
        -------
        Problem
            With one row for each group, in ascending order of their numbers, and metadata of these.

        Raises
        ------
        InvalidArgument
            If `groups` is not one number for each camera, or a group has images of several sizes.
        """
        return selection.with_shared_intrinsics(self, groups)

    def with_added_points(
        self,
        points: ArrayLike,
        camera_index: ArrayLike,
        point_index: ArrayLike,
        pixels: ArrayLike,
        *,
        sigma_px: ArrayLike | None = None,
    ) -> Problem:
        """Copy with more points, such as ground control points with their marks in the images.

        Parameters
        ----------
        points : (n, 3)
            New points; they become points N to N + n − 1, black and not fixed.
        camera_index, point_index : (k,) int
            Camera of each new observation, and which of the new points it sees, from 0.
        pixels : (k, 2)
            Where [px].
        sigma_px : (k,) or float, optional
            Standard deviation of each of these observations [px]. Default: 1 px.

        Returns
        -------
        Problem
            With metadata of all: new points have identifiers of their own, and new observations keypoints.

        Raises
        ------
        InvalidArgument
            If a shape is wrong or a number is out of range.
        """
        return selection.with_added_points(self, points, camera_index, point_index, pixels, sigma_px)

    def copy(self) -> Problem:
        """An independent copy, of the metadata too."""
        return selection.changed(self)

    def _repr_html_(self) -> str:
        """A small table, for notebooks."""
        facts = {
            "camera model": self._model.name,
            "cameras": f"{self.num_cameras:,}",
            "intrinsics": f"{len(self.intrinsics):,} of {', '.join(self.intrinsic_names) or 'no parameters'}",
            "points": f"{self.num_points:,}",
            "observations": f"{self.num_observations:,}",
            "rigs": repr(self.rigs) if self.rigs else "none",
            "read from": self.metadata.source_format or "no file",
        }
        return html_table(facts.items())

    def __repr__(self) -> str:
        columns = (getattr(self, name) for name in ("cameras", "points", "camera_index"))
        cameras, points, observations = ("no" if rows is None else len(rows) for rows in columns)
        return (
            f"Problem({self._model.name!r}: {cameras} cameras, {points} points, {observations} observations"
            f"{' with covariances' if self.covariance_px2 is not None else ''}"
            f"{'' if self.rigs is None else f', {self.rigs.num_frames} rigid frames'})"
        )


def _require_fitting_rigs(rigs: Rigs, cameras: int) -> None:
    if not isinstance(rigs, Rigs):
        raise InvalidArgument(f"rigs = {rigs!r}: must be Rigs or None")
    if rigs.num_cameras != cameras:
        raise InvalidArgument(f"rigs: of {rigs.num_cameras} cameras, the problem has {cameras}")


def _rows_of_intrinsics(rows: FloatArray, names: Sequence[str]) -> FloatArray:
    try:
        return typed_array("intrinsics", rows, np.float64, (-1, len(names)))
    except InvalidArgument as error:
        raise InvalidArgument(f"{error}: {', '.join(names)} of each row") from None


def _require_private_intrinsics(groups: int, cameras: int) -> None:
    if groups != cameras:
        raise InvalidArgument(
            f"intrinsics: {groups} rows for {cameras} cameras, must be equal unless intrinsics_index is given"
        )


def html_table(rows: Iterable[tuple[str, str]]) -> str:
    """Table of names and values, in order; both are text, whatever they hold."""
    lines = (f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>" for name, value in rows)
    return f"<table>{''.join(lines)}</table>"
