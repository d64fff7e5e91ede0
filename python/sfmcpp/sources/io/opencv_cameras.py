"""Cameras of files of OpenCV and ROS by the names of their matrices.

A file of one camera has ``camera_matrix`` (or ``K``) of the images as taken, and may have
``projection_matrix`` (or ``P``) of rectified ones. A file of a stereo pair has two of each: ``M1`` and
``M2``, ``P1`` and ``P2`` as in OpenCV's sample, ``cameraMatrix1``, ``K_left``, ``LEFT.K`` and the like. A
camera is called as its matrix.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sfmcpp.geometry.so3 import nearest_rotation
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.checks import PRINTED_ROTATION_TOLERANCE, is_rotation
from sfmcpp.sources.io.documents import Node
from sfmcpp.sources.io.intrinsics import matrix_fault
from sfmcpp.sources.io.poses import centre_of_projection

_NAMES = {
    "matrix": "camera_?matrix|mtx|K|M",
    "projection": "projection_?matrix|P",
    "distortion": "distortion_?coefficients|dist(?:ortion)?_?coeffs?|distortion|dist|D",
    "rectification": "rectification_?matrix|R",
}
_ONE_OF = "|".join(f"(?P<{role}>{names})" for role, names in _NAMES.items())
_NAME = re.compile(
    rf"(?:(?P<before>left|right)[._]?)?(?:{_ONE_OF})(?:[._]?(?P<after>left|right|l|r|[012]))?", re.IGNORECASE
)
_WHOLE = {"l": "left", "r": "right"}
# Sides that may be beside one, the likeliest first; cameras count from 0 or from 1.
_OTHER_SIDES = {"left": ("right",), "right": ("left",), "0": ("1",), "1": ("2", "0"), "2": ("1",)}
_LIKE_DISTORTION = re.compile(r"(?!.*model).*(dist(?!ance)|coef).*|k_?1", re.IGNORECASE)


class _Name(NamedTuple):
    """What a name in a file means: ``("matrix", "left")`` of ``K_left``; the side of one camera is empty."""

    role: str
    side: str


@dataclass(frozen=True, eq=False)
class OpencvCamera:
    """A camera of a file.

    Attributes
    ----------
    root : Node
        The file.
    name : str
        Of its matrix there.
    side : str
        Which of a pair it is: ``"left"``, ``"right"`` or a digit; empty if its name does not tell.
    rectified : bool
        Whether it is that of rectified images, without distortion.
    """

    root: Node
    name: str
    side: str
    rectified: bool

    @property
    def matrix(self) -> Node:
        """Its matrix in the file."""
        node = self.root.part(self.name)
        assert node is not None
        return node

    def calibration_matrix(self) -> FloatArray:
        """K (3, 3).

        Raises
        ------
        DatasetError
            If its matrix is none of a camera.
        """
        return _calibration_matrix(self.matrix, self.rectified)

    def distortion(self) -> Node | None:
        """Its coefficients; None if the file has none, or the images are free of distortion.

        Raises
        ------
        DatasetError
            If they seem to have another name.
        """
        if self.rectified:
            return None
        found = self._part("distortion")
        if found is None:
            _refuse_other_distortion(self.root)
        return found

    def other(self) -> OpencvCamera | None:
        """The camera on the other side of the pair, for the same images; None if the file has none."""
        others = [c for c in opencv_cameras(self.root).values() if c.rectified == self.rectified]
        sides = {camera.side: camera for camera in others}
        return next((sides[s] for s in _OTHER_SIDES.get(self.side, ()) if s in sides), None)

    def rectified_centre(self) -> FloatArray | None:
        """Centre c (3,) in the axes of the rectified pair, of P = K [I | −c]; None without P.

        Raises
        ------
        DatasetError
            If P is no projection matrix.
        """
        node = self._part("projection")
        if node is None:
            return None
        _calibration_matrix(node, of_projection=True)
        return centre_of_projection(matrix_of(node, 3, 4))

    def rectified_from_camera(self) -> FloatArray | None:
        """Rotation (3, 3) from the camera to the axes of the rectified pair; None if the file has none.

        Raises
        ------
        DatasetError
            If what the file has there is none.
        """
        if self.rectified:
            return np.eye(3)
        node = self._part("rectification")
        return None if node is None else rotation_of(node)

    def _part(self, role: str) -> Node | None:
        found = (name for name, means in _names(self.root) if means == (role, self.side))
        return self.root.part(*found)


def opencv_cameras(root: Node) -> dict[str, OpencvCamera]:
    """All cameras of a file by their names, those of images as taken first."""
    found: dict[_Name, str] = {}
    for name, means in _names(root):
        found.setdefault(means, name)
    return {
        name: OpencvCamera(root, name, means.side, role == "projection")
        for role in ("matrix", "projection")
        for means, name in found.items()
        if means.role == role
    }


def _names(root: Node) -> Iterator[tuple[str, _Name]]:
    """The names in a file that mean something, with what; no single words: K1 may be a coefficient."""
    for name, node in root.value.items() if isinstance(root.value, dict) else ():
        match = _NAME.fullmatch(name)
        is_word = isinstance(node.value, str) and len(node.value.split()) < 2
        if match is None or (match["before"] and match["after"]) or is_word:
            continue
        role = next(role for role in _NAMES if match[role])
        side = (match["before"] or match["after"] or "").lower()
        # ROS 2 has small letters for one camera; beside a digit they are coefficients: k1, p1.
        if not (side and match[role] in "kmdpr"):
            yield name, _Name(role, _WHOLE.get(side, side))


def _refuse_other_distortion(root: Node) -> None:
    read = {name for name, _ in _names(root)}
    for name, node in root.value.items() if isinstance(root.value, dict) else ():
        if name not in read and _LIKE_DISTORTION.fullmatch(name):
            raise node.error(f"{name} is not read: distortion must be called distortion_coefficients, or D")


def rotation_of(node: Node) -> FloatArray:
    """A rotation (3, 3), made exact.

    Raises
    ------
    DatasetError
        If it is none.
    """
    return exact_rotation(node, matrix_of(node, 3, 3), "it")


def exact_rotation(node: Node, matrix: FloatArray, name: str) -> FloatArray:
    """The rotation nearest to a printed one (3, 3) of a part of a file, by its name in messages.

    Raises
    ------
    DatasetError
        If it is none.
    """
    if not is_rotation(matrix, PRINTED_ROTATION_TOLERANCE):
        raise node.error(f"{name} holds no rotation")
    return nearest_rotation(matrix)


def matrix_of(node: Node, rows: int, columns: int) -> FloatArray:
    """A matrix (rows, columns).

    Raises
    ------
    DatasetError
        If there are not as many numbers.
    """
    numbers = node.numbers()
    if len(numbers) != rows * columns:
        raise node.error(
            f"holds {len(numbers)} numbers: must be {rows * columns}, a matrix of {rows}×{columns}"
        )
    return np.reshape(numbers, (rows, columns))


def _calibration_matrix(node: Node, of_projection: bool) -> FloatArray:
    square = matrix_of(node, 3, 4 if of_projection else 3)[:, :3]
    if (fault := matrix_fault(square)) is not None:
        raise node.error(fault)
    return square
