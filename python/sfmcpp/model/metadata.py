"""What files say of a problem beyond the problem itself."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arrays import ANY, FloatArray, IndexArray, number_array

# Entries of `Metadata.extra` with a number for each observation, and for each point.
KEYPOINTS = "colmap_keypoint_index"
# The image, number and pixel of each keypoint that sees no point.
LOOSE = ("colmap_loose_image", "colmap_loose_keypoint_index", "colmap_loose_pixels")
_OF_OBSERVATIONS = (KEYPOINTS, "bundler_keys", "nvm_keys")
_OF_POINTS = ("colmap_point_ids", "g2o_point_ids")
# What entries are arrays of, in the letters of `numpy.dtype.kind`, and their shapes.
_INTEGERS, _NUMBERS, _YES_OR_NO = ("iu", "integers"), ("iuf", "numbers"), ("b", "booleans")
_LIST, _PAIRS, _TRIPLES = (ANY,), (ANY, 2), (ANY, 3)
_ARRAYS = {
    **dict.fromkeys((*_OF_OBSERVATIONS, *_OF_POINTS, *LOOSE[:2]), (_INTEGERS, _LIST)),
    LOOSE[2]: (_NUMBERS, _PAIRS),
    "colmap_camera_ids": (_INTEGERS, _LIST),
    "colmap_image_ids": (_INTEGERS, _LIST),
    "colmap_frame_ids": (_INTEGERS, _LIST),
    "colmap_rig_ids": (_INTEGERS, _LIST),
    "colmap_sensor_rows": (_INTEGERS, _LIST),
    "colmap_camera_sizes": (_INTEGERS, _PAIRS),
    "colmap_second_sightings": (_INTEGERS, _TRIPLES),
    "bundler_registered": (_YES_OR_NO, _LIST),
    "nvm_measurement_distortion": (_NUMBERS, _LIST),
}
_TEXTS = ("colmap_camera_models", "unregistered_images")


@dataclass(repr=False, eq=False)
class Metadata:
    """What files say beyond the problem itself; kept so that read, write, read loses nothing.

    Attributes
    ----------
    source_format : str
        Format the problem was read from, or empty.
    image_names : list of str
        One name per camera, or empty.
    image_sizes : (C, 2) int array or None
        Width and height of each camera's image [px].
    point_colors : (N, 3) uint8 array or None
        Red, green, blue of each point.
    extra : dict
        Anything else a format needs to write itself back (identifiers, keypoint numbers…).
    """

    source_format: str = ""
    image_names: list[str] = field(default_factory=list)
    image_sizes: NDArray[np.int64] | None = None
    point_colors: NDArray[np.uint8] | None = None
    extra: dict[str, Any] = field(default_factory=dict)

    def __repr__(self) -> str:
        known = [f"from {self.source_format!r}"] if self.source_format else []
        for name in ("image_names", "image_sizes", "point_colors"):
            value = getattr(self, name)
            known += [f"{len(value)} {name}"] if value is not None and len(value) else []
        known += [f"extra: {', '.join(map(str, self.extra))}"] if self.extra else []
        return f"Metadata({'; '.join(known)})"

    def names(self, count: int) -> list[str]:
        """Names of `count` images: those that are known, or ``image_000001`` and so on where none are."""
        return self.image_names or [f"image_{i:06d}" for i in range(1, count + 1)]

    def of_observations(self, chosen: NDArray[Any], camera_index: IndexArray, pixels: FloatArray) -> Metadata:
        """Those of some observations, numbers or a mask, of the M that have these cameras and `pixels`.

        Keypoints of an image are numbered without a gap: those of the others are kept, and see no point.
        """
        count = len(camera_index)
        require_entries(self.extra)
        extra = _rows_of(self.extra, _OF_OBSERVATIONS, chosen, count)
        if extra.get(KEYPOINTS) is not self.extra.get(KEYPOINTS):
            left = np.ones(count, dtype=np.bool_)
            left[chosen] = False
            for name, values in zip(LOOSE, (camera_index, self.extra[KEYPOINTS], pixels), strict=True):
                known, more = extra.get(name), np.asarray(values)[left]
                extra[name] = more if known is None else np.concatenate([known, more])
        return replace(self, extra=extra)

    def of_points(self, chosen: NDArray[np.int64], count: int) -> Metadata:
        """Those of some of `count` points, by number."""
        require_entries(self.extra)
        colors = None if self.point_colors is None else self.point_colors[chosen]
        return replace(self, point_colors=colors, extra=_rows_of(self.extra, _OF_POINTS, chosen, count))


def keypoint_entries(
    observed: NDArray[Any], loose_image: NDArray[Any], loose_number: NDArray[Any], loose_pixels: FloatArray
) -> dict[str, Any]:
    """Entries of `Metadata.extra`: keypoint numbers of the observations, and keypoints that see no point."""
    loose = (loose_image, loose_number, loose_pixels)
    return {KEYPOINTS: observed, **dict(zip(LOOSE, loose, strict=True))}


def require_entries(extra: dict[str, Any]) -> None:
    """Raise InvalidArgument at the first known entry that is not of the kind that it is known for."""
    for name in _ARRAYS.keys() & extra.keys():
        _require_array(name, number_array(f"metadata {name}", extra[name]))
    for name in _TEXTS:
        if not _are_texts(extra.get(name, ())):
            raise InvalidArgument(f"metadata {name} = {extra[name]!r}: must be a list of str")
    lengths = [len(extra.get(name, ())) for name in LOOSE]
    if len(set(lengths)) > 1:
        told = ", ".join(f"{name} {length}" for name, length in zip(LOOSE, lengths, strict=True))
        raise InvalidArgument(f"metadata of keypoints that see no point differ in length: {told}")


def _require_array(name: str, array: NDArray[Any]) -> None:
    (kinds, what), shape = _ARRAYS[name]
    if array.ndim != len(shape) or shape[-1] not in (ANY, array.shape[-1]):
        wanted = ", ".join("any" if n == ANY else str(n) for n in shape)
        raise InvalidArgument(f"metadata {name}: shape {array.shape}, must be ({wanted})")
    if array.size and array.dtype.kind not in kinds:
        raise InvalidArgument(f"metadata {name}: {array.dtype}, must be {what}")


def _are_texts(value: object) -> bool:
    return isinstance(value, (list, tuple)) and all(isinstance(text, str) for text in value)


def _rows_of(
    extra: dict[str, Any], names: tuple[str, ...], chosen: NDArray[Any], count: int
) -> dict[str, Any]:
    """`extra` with some rows of the named entries, where these have `count` of them."""
    fitting = [name for name in names if name in extra and np.shape(extra[name]) == (count,)]
    return extra | {name: np.asarray(extra[name])[chosen] for name in fitting}
