"""The camera models by name: their intrinsic parameters and which of them are free by default."""

from __future__ import annotations

from dataclasses import dataclass

from sfmcpp.errors import InvalidArgument


@dataclass(frozen=True)
class CameraModel:
    """Name and intrinsic parameters of a camera model.

    With the point at ``(x, y, 1)`` after division by its depth and ``r² = x² + y²``:

    - ``calibrated``: ``u = f x + skew y + cx``, ``v = aspect f y + cy``, all five fixed.
    - ``perspective``: the same after distortion: ``(x, y)`` is first scaled by
      ``1 + k1 r² + k2 r⁴ + k3 r⁶ + k4 r⁸ + k5 r¹⁰``, then the tangential terms
      ``(2 p1 x y + p2 (r² + 2 x²), p1 (r² + 2 y²) + 2 p2 x y)`` are added.
    - ``bal``: ``(u, v) = f (1 + k1 r² + k2 r⁴) (x, y)``: square pixels, principal point at the origin.

    Attributes
    ----------
    name : str
        Its name.
    intrinsics : tuple of str
        Names of its intrinsic parameters, in the order they are stored.
    free_by_default : frozenset of str
        Those that a problem leaves free unless it says otherwise.
    """

    name: str
    intrinsics: tuple[str, ...]
    free_by_default: frozenset[str]


_PINHOLE = ("f", "aspect", "cx", "cy", "skew")
_DISTORTION = ("k1", "k2", "k3", "k4", "k5", "p1", "p2")

CAMERA_MODELS: dict[str, CameraModel] = {
    model.name: model
    for model in (
        CameraModel("calibrated", _PINHOLE, frozenset()),
        CameraModel("perspective", _PINHOLE + _DISTORTION, frozenset({"f"})),
        CameraModel("bal", ("f", "k1", "k2"), frozenset({"f", "k1", "k2"})),
    )
}


def camera_model(name: str) -> CameraModel:
    """Look a camera model up by name.

    Parameters
    ----------
    name : str
        ``"calibrated"``, ``"perspective"`` or ``"bal"``.

    Returns
    -------
    CameraModel
        Its intrinsic parameters and which are free by default.

    Raises
    ------
    InvalidArgument
        If no camera model has that name.
    """
    try:
        return CAMERA_MODELS[name]
    except KeyError:
        known = ", ".join(CAMERA_MODELS)
        raise InvalidArgument(f"camera_model = {name!r}: must be one of {known}") from None
