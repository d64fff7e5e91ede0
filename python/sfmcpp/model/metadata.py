"""Metadata of a problem, which files may hold beside cameras, points and observations; the world origin."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arrays import ANY, FloatArray, IndexArray, finite_array, new_numbers, number_array
from sfmcpp.model.named_fields import NamedFields

# Entries of `Metadata.extra` with a number for each observation, and for each point.
KEYPOINTS = "colmap_keypoint_index"
# The image, number and pixel of each keypoint that sees no point.
LOOSE = ("colmap_loose_image", "colmap_loose_keypoint_index", "colmap_loose_pixels")
_OF_OBSERVATIONS = (KEYPOINTS, "bundler_keys", "nvm_keys")
_OF_POINTS = ("colmap_point_ids", "g2o_point_ids")
# For each camera, row of intrinsics, frame and sensor.
_OF_CAMERAS = ("colmap_image_ids", "nvm_measurement_distortion")
_OF_INTRINSICS = ("colmap_camera_ids", "colmap_camera_sizes", "colmap_camera_models")
FRAME_IDS, RIG_IDS, SENSOR_ROWS = "colmap_frame_ids", "colmap_rig_ids", "colmap_sensor_rows"
# (D, 3): the camera, the keypoint's number in its image, and COLMAP's id of the point of second sightings.
SECOND_SIGHTINGS = "colmap_second_sightings"
# Which of the cameras of the file are those of the problem.
REGISTERED = "bundler_registered"
# What entries are arrays of, in the letters of `numpy.dtype.kind`, and their shapes.
_INTEGERS, _NUMBERS, _YES_OR_NO = ("iu", "integers"), ("iuf", "numbers"), ("b", "booleans")
_LIST, _PAIRS, _TRIPLES = (ANY,), (ANY, 2), (ANY, 3)
_ARRAYS = {
    **dict.fromkeys((*_OF_OBSERVATIONS, *_OF_POINTS, *LOOSE[:2]), (_INTEGERS, _LIST)),
    LOOSE[2]: (_NUMBERS, _PAIRS),
    "colmap_camera_ids": (_INTEGERS, _LIST),
    "colmap_image_ids": (_INTEGERS, _LIST),
    **dict.fromkeys((FRAME_IDS, RIG_IDS, SENSOR_ROWS), (_INTEGERS, _LIST)),
    "colmap_camera_sizes": (_INTEGERS, _PAIRS),
    SECOND_SIGHTINGS: (_INTEGERS, _TRIPLES),
    REGISTERED: (_YES_OR_NO, _LIST),
    "nvm_measurement_distortion": (_NUMBERS, _LIST),
}
_TEXTS = ("colmap_camera_models", "unregistered_images")
_NAMES = {True: ("latitude_deg", "longitude_deg", "height_m"), False: ("x_m", "y_m", "z_m")}
_KEYS = {True: "origin_geodetic", False: "origin_xyz_m"}


@dataclass(repr=False, eq=False)
class Metadata(NamedFields):
    """Contents of files beyond the problem itself; kept so that read, write, read loses nothing.

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
        self.require_names()
        return self.image_names or [f"image_{i:06d}" for i in range(1, count + 1)]

    def require_names(self) -> None:
        """Raise InvalidArgument unless `image_names` are a list of texts."""
        names = self.image_names
        if not isinstance(names, list | tuple):
            raise InvalidArgument(f"metadata image_names: is a {type(names).__name__}, must be a list of str")
        for number, name in enumerate(names):
            if not isinstance(name, str):
                raise InvalidArgument(f"metadata image_names[{number}] = {name!r}: must be text")

    def ids_of_points(self, points: Sequence[int], count: int) -> str:
        """COLMAP's ids of some of `count` points for a message, ``"POINT3D_ID 7, 12"``; empty if unknown."""
        ids = np.asarray(self.extra.get(_OF_POINTS[0], ()))
        known = ids.shape == (count,) and len(points) > 0
        return f"POINT3D_ID {', '.join(str(ids[p]) for p in points)}" if known else ""

    def of_observations(self, chosen: NDArray[Any], camera_index: IndexArray, pixels: FloatArray) -> Metadata:
        """Metadata of some observations, by number or mask, of the M that have these cameras and `pixels`.

        Keypoints of an image are numbered without a gap: those of the others are kept, and see no point.
        """
        count = len(camera_index)
        require_entries(self.extra)
        extra = _rows_of_entries(self.extra, _OF_OBSERVATIONS, chosen, count)
        if extra.get(KEYPOINTS) is not self.extra.get(KEYPOINTS):
            left = np.ones(count, dtype=np.bool_)
            left[chosen] = False
            for name, values in zip(LOOSE, (camera_index, self.extra[KEYPOINTS], pixels), strict=True):
                known, more = extra.get(name), np.asarray(values)[left]
                extra[name] = more if known is None else np.concatenate([known, more])
        return replace(self, extra=extra)

    def of_points(self, chosen: NDArray[np.int64], count: int) -> Metadata:
        """Metadata of some of `count` points, by number."""
        require_entries(self.extra)
        colors = _rows_of_array("point_colors", self.point_colors, chosen, count)
        return replace(
            self, point_colors=colors, extra=_rows_of_entries(self.extra, _OF_POINTS, chosen, count)
        )

    def of_cameras(self, chosen: NDArray[np.int64], count: int) -> Metadata:
        """Metadata of some of `count` cameras, by number: keypoints of the others are gone."""
        require_entries(self.extra)
        self.require_names()
        extra, number = _rows_of_entries(self.extra, _OF_CAMERAS, chosen, count), new_numbers(chosen, count)
        if LOOSE[0] in extra:
            images = _renumbered(extra[LOOSE[0]], number)
            extra |= {name: np.asarray(extra[name])[images >= 0] for name in LOOSE[1:]}
            extra[LOOSE[0]] = images[images >= 0]
        if SECOND_SIGHTINGS in extra:
            sightings = np.array(extra[SECOND_SIGHTINGS], dtype=np.int64)
            sightings[:, 0] = _renumbered(sightings[:, 0], number)
            extra[SECOND_SIGHTINGS] = sightings[sightings[:, 0] >= 0]
        places = np.flatnonzero(extra.get(REGISTERED, ()))
        if len(places) == count and (np.diff(chosen) > 0).all():
            extra[REGISTERED] = np.isin(np.arange(len(extra[REGISTERED])), places[chosen])
        elif REGISTERED in extra:  # in another order the file's cameras are not told any more
            del extra[REGISTERED]
        if self.image_names:
            _require_count("image_names", self.image_names, count)
        names = [self.image_names[i] for i in chosen] if self.image_names else []
        sizes = _rows_of_array("image_sizes", self.image_sizes, chosen, count)
        return replace(self, image_names=names, image_sizes=sizes, extra=extra)

    def of_intrinsics(self, chosen: NDArray[np.int64], number: IndexArray) -> Metadata:
        """Metadata of some rows of intrinsics; `number` has the new number of each row, −1 where it is gone.

        A row that is chosen again is a camera of its own, with an identifier of its own.
        """
        require_entries(self.extra)
        extra = _rows_of_entries(self.extra, _OF_INTRINSICS, chosen, len(number))
        if len(ids := extra.get("colmap_camera_ids", ())) == len(chosen) > 0:
            again = np.setdiff1d(np.arange(len(ids)), np.unique(ids, return_index=True)[1])
            ids[again] = _next_numbers(self.extra["colmap_camera_ids"], len(again))
        if SENSOR_ROWS in extra:
            extra[SENSOR_ROWS] = _renumbered(extra[SENSOR_ROWS], number)
            if (extra[SENSOR_ROWS] < 0).any():
                del extra[SENSOR_ROWS]
        return replace(self, extra=extra)

    def of_rigs(self, frames: NDArray[Any], sensors: NDArray[Any], num_sensors: int) -> Metadata:
        """Metadata of some frames, and of some of `num_sensors` sensors, by number."""
        extra = _rows_of_entries(self.extra, (RIG_IDS, SENSOR_ROWS), sensors, num_sensors)
        if len(ids := extra.get(FRAME_IDS, ())) > frames.max(initial=-1):
            extra[FRAME_IDS] = np.asarray(ids)[frames]
        return replace(self, extra=extra)

    def with_added_points(self, count: int, camera_index: IndexArray, added: IndexArray) -> Metadata:
        """Metadata with `count` points more, black, and a keypoint for each new observation.

        Parameters
        ----------
        count : int
            How many points.
        camera_index, added : (M,) and (k,) int32
            Cameras of the observations that are there, and of those that are new.
        """
        require_entries(self.extra)
        extra = dict(self.extra)
        for name in _OF_POINTS:
            if name in extra:
                extra[name] = np.concatenate([extra[name], _next_numbers(extra[name], count)])
        for name in _OF_OBSERVATIONS:
            if len(extra.get(name, ())) == len(camera_index) and name in extra:
                images, numbers = camera_index, np.asarray(extra[name])
                if name == KEYPOINTS and LOOSE[0] in extra:
                    images = np.concatenate([images, extra[LOOSE[0]]])
                    numbers = np.concatenate([numbers, extra[LOOSE[1]]])
                extra[name] = np.concatenate([extra[name], _next_of_images(images, numbers, added)])
        colors = self.point_colors
        if colors is not None:
            colors = np.concatenate([colors, np.zeros((count, 3), colors.dtype)])
        return replace(self, point_colors=colors, extra=extra)

    def copy(self) -> Metadata:
        """An independent copy."""
        extra = {name: copy(value) for name, value in self.extra.items()}
        return replace(
            self,
            image_names=copy(self.image_names),
            image_sizes=copy(self.image_sizes),
            point_colors=copy(self.point_colors),
            extra=extra,
        )


def some_metadata(value: Metadata | None) -> Metadata:
    """The argument `metadata`, empty ones for None; InvalidArgument for anything else."""
    if value is not None and not isinstance(value, Metadata):
        raise InvalidArgument(f"metadata = {value!r}: must be Metadata or None")
    return Metadata() if value is None else value


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
            found = " ".join(repr(extra[name]).split())  # an array has lines
            raise InvalidArgument(f"metadata {name} = {found}: must be a list of str")
    WorldOrigin.of_entries(extra)
    lengths = [len(extra.get(name, ())) for name in LOOSE]
    if len(set(lengths)) > 1:
        lengths_text = ", ".join(f"{name} {length}" for name, length in zip(LOOSE, lengths, strict=True))
        raise InvalidArgument(f"metadata of keypoints that see no point differ in length: {lengths_text}")


def _require_array(name: str, array: NDArray[Any]) -> None:
    (kinds, what), shape = _ARRAYS[name]
    if array.ndim != len(shape) or shape[-1] not in (ANY, array.shape[-1]):
        wanted = ", ".join("any" if n == ANY else str(n) for n in shape)
        raise InvalidArgument(f"metadata {name}: shape {array.shape}, must be ({wanted})")
    if array.size and array.dtype.kind not in kinds:
        raise InvalidArgument(f"metadata {name}: {array.dtype}, must be {what}")


def _are_texts(value: object) -> bool:
    return isinstance(value, (list, tuple)) and all(isinstance(text, str) for text in value)


def _rows_of_entries(
    extra: dict[str, Any], names: tuple[str, ...], chosen: NDArray[Any], count: int
) -> dict[str, Any]:
    """`extra` with some rows of the named entries, where these have `count` of them."""
    fitting = [name for name in names if name in extra and len(extra[name]) == count]
    return extra | {name: _chosen_rows(extra[name], chosen) for name in fitting}


def _rows_of_array(
    name: str, values: NDArray[Any] | None, chosen: NDArray[Any], count: int
) -> NDArray[Any] | None:
    """Some rows of an attribute that has `count` of them, or is None."""
    if values is None:
        return None
    _require_count(name, values, count)
    rows: NDArray[Any] = np.asarray(values)[chosen]
    return rows


def _require_count(name: str, values: Any, count: int) -> None:
    if len(values) != count:
        raise InvalidArgument(f"metadata {name}: {len(values)} entries, must be {count}")


def _chosen_rows(values: Any, chosen: NDArray[Any]) -> Any:
    if _are_texts(values):
        return np.array(values, dtype=object)[chosen].tolist()
    return np.asarray(values)[chosen]


def _renumbered(values: Any, number: IndexArray) -> NDArray[np.int64]:
    """Renumbered values; −1 for values that are unknown."""
    old = np.asarray(values, dtype=np.int64)
    known = (old >= 0) & (old < len(number))
    result = np.full(len(old), -1, dtype=np.int64)
    result[known] = number[old[known]]
    return result


def _next_numbers(known: Any, count: int) -> NDArray[np.int64]:
    """The `count` numbers after the largest that is known; from 1 on where none is."""
    return np.arange(1, count + 1) + int(np.max(known, initial=0))


def _next_of_images(images: NDArray[Any], numbers: NDArray[Any], added: NDArray[Any]) -> NDArray[np.int64]:
    """(k,) numbers of new keypoints of the images `added`, after those (n,) that each image has."""
    ends = np.full(int(max(images.max(initial=-1), added.max(initial=-1))) + 1, -1, dtype=np.int64)
    np.maximum.at(ends, images, numbers)
    order = np.argsort(added, kind="stable")
    first = np.searchsorted(added[order], added[order])
    result = np.empty(len(added), dtype=np.int64)
    result[order] = ends[added[order]] + 1 + np.arange(len(added)) - first
    return result


@dataclass(frozen=True, eq=False)
class WorldOrigin:
    """Origin of a world in metres.

    Attributes
    ----------
    place : (3,) float64
        Latitude, longitude [deg, WGS84] and height [m], the axes of the world east, north, up; or x, y, z in
        a metric frame with the same axes [m].
    geodetic : bool
        Which of both.
    """

    place: FloatArray
    geodetic: bool

    @classmethod
    def of(cls, metadata: Metadata) -> WorldOrigin | None:
        """The origin in ``metadata.extra``; None if there is none."""
        return cls.of_entries(metadata.extra)

    @classmethod
    def of_entries(cls, extra: dict[str, Any]) -> WorldOrigin | None:
        """The origin in entries of metadata; InvalidArgument if it is not three finite numbers."""
        for geodetic, key in _KEYS.items():
            if key in extra:
                return cls(finite_array(f"metadata {key}", extra[key], (3,)), geodetic)
        return None

    def put_into(self, metadata: Metadata) -> None:
        """Tell it in ``metadata.extra``, in place of any other."""
        for key in _KEYS.values():
            metadata.extra.pop(key, None)
        metadata.extra[_KEYS[self.geodetic]] = np.array(self.place, dtype=np.float64)

    def to_dict(self) -> dict[str, float]:
        """Its three numbers, by names with units."""
        return dict(zip(_NAMES[self.geodetic], np.asarray(self.place).tolist(), strict=True))

    @classmethod
    def from_dict(cls, entries: dict[str, Any]) -> WorldOrigin:
        """:meth:`to_dict` backwards.

        Raises
        ------
        InvalidArgument
            If it is none, or not finite.
        """
        for geodetic, names in _NAMES.items():
            if set(entries) == set(names):
                return cls(finite_array("origin", [entries[name] for name in names], (3,)), geodetic)
        known = " or ".join(", ".join(names) for names in _NAMES.values())
        raise InvalidArgument(f"origin: has {', '.join(entries) or 'nothing'}, must have {known}")
