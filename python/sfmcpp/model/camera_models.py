"""Camera models by name: their intrinsic parameters and which are free by default."""

from __future__ import annotations

from dataclasses import dataclass

from sfmcpp import _core
from sfmcpp.errors import InvalidArgument
from sfmcpp.model.camera_function import CameraFunction
from sfmcpp.model.checks import looked_up


@dataclass(frozen=True)
class CameraModel:
    """Name and intrinsic parameters of a camera model.

    With the point at ``(x, y, 1)`` after division by its depth and ``r² = x² + y²``:

    - ``calibrated``: ``u = f x + skew y + cx``, ``v = aspect f y + cy``, all five fixed.
    - ``perspective``: the same after distortion: ``(x, y)`` is first scaled by
      ``1 + k1 r² + k2 r⁴ + k3 r⁶ + k4 r⁸ + k5 r¹⁰``, then the tangential terms
      ``(2 p1 x y + p2 (r² + 2 x²), p1 (r² + 2 y²) + 2 p2 x y)`` are added.
    - ``bal``: ``(u, v) = f (1 + k1 r² + k2 r⁴) (x, y)``: square pixels, principal point at the origin.
    - ``projective``: no pose but a 3×4 matrix P, and homogeneous points Q of four numbers; with
      ``(x, y, w) = P Q``: ``u = scale x / w + cx``, ``v = scale y / w + cy``. The three are the frame of the
      image, fixed: P is to normalised pixels. See :func:`sfmcpp.projective_problem`.

    Attributes
    ----------
    name : str
        Its name.
    intrinsics : tuple of str
        Names of its intrinsic parameters, in the order they are stored.
    free_by_default : frozenset of str
        Those that a problem leaves free unless it says otherwise.
    can_be_free : bool
        Whether any of them may be free.
    metric : bool
        Whether its cameras are poses ``[R | c]`` in a Euclidean world.
    """

    name: str
    intrinsics: tuple[str, ...]
    free_by_default: frozenset[str]
    can_be_free: bool = True
    metric: bool = True

    @property
    def point_size(self) -> int:
        """Numbers stored for a point: 3, or 4 for homogeneous ones."""
        return 3 if self.metric else 4


_FREE_BY_DEFAULT = {"perspective": ("f",), "bal": ("f", "k1", "k2")}

# What COLMAP and OpenCV call intrinsics that have another name here; `aspect` is fy / fx.
OTHER_NAMES = {"k": "k1", "fx": "f", "fy": "aspect", "focal_length": "f"}

CAMERA_MODELS: dict[str, CameraModel] = {
    m.name: CameraModel(
        m.name, tuple(m.intrinsics), frozenset(_FREE_BY_DEFAULT.get(m.name, ())), m.can_be_free, m.metric
    )
    for m in _core.CAMERA_MODELS
}

# Intrinsic parameters of perspective cameras, in the order they are stored.
PERSPECTIVE = CAMERA_MODELS["perspective"].intrinsics
PINHOLE_MODELS = ("calibrated", "perspective", "bal")


def camera_model(name: str | CameraFunction) -> CameraModel | CameraFunction:
    """Look a camera model up by name.

    Parameters
    ----------
    name : str or CameraFunction
        ``"calibrated"``, ``"perspective"``, ``"bal"`` or ``"projective"``. A function is its own model.

    Returns
    -------
    CameraModel or CameraFunction
        Its intrinsic parameters and which are free by default.

    Raises
    ------
    InvalidArgument
        If no camera model has that name.
    """
    if isinstance(name, CameraFunction):
        return name
    return looked_up("camera_model", name, CAMERA_MODELS)


def require_named(model: str | CameraFunction, what: str) -> str:
    """The name of a camera model; InvalidArgument if it is a function, which `what` cannot take."""
    if isinstance(model, CameraFunction):
        raise InvalidArgument(f"camera_model = {model!r}: must be the name of a model {what}")
    return model


def is_pinhole(model: str | CameraFunction) -> bool:
    """Whether a camera model is a pinhole with a lens, of which rays are known."""
    return not isinstance(model, CameraFunction) and camera_model(model).name in PINHOLE_MODELS


def require_pinhole(model: str | CameraFunction) -> str:
    """The name of a camera model of which rays are known, a pinhole with a lens; else InvalidArgument."""
    name = camera_model(model).name
    if not is_pinhole(model):
        rule = "must be 'calibrated', 'perspective' or 'bal'"
        raise InvalidArgument(f"camera_model = {name!r}: {rule}")
    return name
