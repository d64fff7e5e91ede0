"""Constraints on cameras, from a second sensor or from what is known beforehand, in named weighted groups."""

from __future__ import annotations

from collections.abc import Sequence, Sized
from dataclasses import InitVar, dataclass, field
from typing import TYPE_CHECKING
from unicodedata import combining

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp import _core
from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arguments import check_fields
from sfmcpp.model.arrays import (
    ANY,
    FloatArray,
    IndexArray,
    as_stored,
    finite_array,
    number_array,
    require_int32,
)
from sfmcpp.model.checks import looked_up, require_positive, require_text
from sfmcpp.model.loss_function import LossFunction
from sfmcpp.model.named_fields import NamedFields
from sfmcpp.model.names import ConstraintKindName

NO_CAMERA = -1


ConstraintKind = _core.ConstraintKind

CONSTRAINT_KINDS: dict[str, ConstraintKind] = {kind.name: kind for kind in _core.CONSTRAINT_KINDS}


class MemberGroup(NamedFields):
    """Base of all groups: a name, and fields that can be checked again."""

    name: str

    def __post_init__(self) -> None:
        self.validate()

    def validate(self) -> None:
        """Check all fields, as when the group was made; they may have been set since.

        Raises
        ------
        InvalidArgument
            If a field breaks a rule.
        """
        require_text("name", self.name)
        self._check()

    def _check(self) -> None:
        raise NotImplementedError

    def _label(self, field_name: str) -> str:
        return f"constraints[{self.name!r}].{field_name}"


@dataclass(eq=False)
class ConstraintGroup(MemberGroup):
    """Constraints of one kind from one source, with one weight: a GPS, an odometer, a prior.

    In :func:`sfmcpp.solve` the group adds ``½ weight Σ member_weights · ε`` to the cost, each ε a *mean*
    squared error (thesis table 5.1): the squared error over its number of entries d, or of points for kinds
    that compare images. `sigma` sets the weight from a standard deviation σ: d / σ² in the unit of the error;
    for σ radians about each axis, 9 / (2 σ²) for a matrix of nine entries and 3 / σ² for the logarithm. Files
    do not store constraints.

    With ``[R | t]`` the pose of a camera (rotation world_from_camera, centre in the world), hats for the
    values and "previous" for the first of two cameras:

    {kinds}

    Lengths have the unit of the world. "focal" and "principal-point" accept two cameras instead of a value:
    the intrinsics of the previous one are then the value.

    Parameters
    ----------
    kind : str
        One of `CONSTRAINT_KINDS`.
    cameras : (n,) or (n, 2) int32
        The camera of each member; for kinds between two cameras the previous one and this one.
    values : array, optional
        Measurements, with the shape in the table; None for kinds without.
    weight : float
        Weight of the group; 0: no effect. It may be changed between solves, or chosen from the data:
        ``solve(..., weight="auto")``.
    member_weights : (n,) or (n, d) float64, optional
        Weight of each member, or for kinds with vectors of d numbers of each number, along the axes of the
        frame. 1 / σ² with weight d; only ratios count with a chosen weight. Default: 1.
    name : str
        Name of the group in summaries and messages, unique in a solve. Default: the kind.
    points : sequence of n (k, 3) float64, optional
        World points, one array per member, for kinds that compare images; held fixed. Distortion is ignored.
        Images use the intrinsics at the start of the solve: where the focal length is free,
        :func:`sfmcpp.linearize` at the end gives another cost of the group.
    loss : str or LossFunction
        Robust loss ρ of each member, for a sensor with outliers: ``"squared"`` (none), ``"huber"``,
        ``"cauchy"``, ``"tukey"``, ``"geman-mcclure"`` or ``"truncated"``, or one of your own. The group then
        adds ``½ Σ ρ(weight · member_weight · ε)``.
    loss_scale : float, optional
        Where the loss leaves the parabola, in standard deviations of the sensor, with the weight d / σ².
        Default: 95 % efficiency on normal errors, as for observations; of one of your own: 1.
    sigma : float, (n,) or (n, d) float64, optional
        Instead of weights: standard deviation of the sensor, of each member, or of each number for kinds with
        vectors of d numbers. Units: that of the world (metres); rotations: radians about each axis; kinds
        that compare images: pixels; "focal": fraction of f; "pose", "displacement-pose" and "smoothing":
        metres, and 1 / √2 of it in radians. Relative to observations in units of their own σ (1 px by
        default). Not stored: it sets `weight` and `member_weights`.

    Raises
    ------
    InvalidArgument
        If a shape is wrong, a number is not finite, a σ is not positive or given together with a weight.
        Indices, rotations and weights are checked by the solve.
    """

    kind: ConstraintKindName | str
    cameras: IndexArray
    values: FloatArray | None = None
    weight: float = 1.0
    member_weights: FloatArray = None  # type: ignore[assignment]
    name: str = ""
    points: Sequence[FloatArray] = field(default=(), repr=False)
    loss: LossFunction | str = "squared"
    loss_scale: float | None = None
    sigma: InitVar[ArrayLike | None] = None

    if TYPE_CHECKING:  # what is given need not be what is held

        def __init__(
            self,
            kind: ConstraintKindName | str,
            cameras: ArrayLike,
            values: ArrayLike | None = None,
            weight: float = 1.0,
            member_weights: ArrayLike | None = None,
            name: str = "",
            points: Sequence[ArrayLike] = (),
            loss: LossFunction | str = "squared",
            loss_scale: float | None = None,
            sigma: ArrayLike | None = None,
        ) -> None: ...

    def __setattr__(self, name: str, value: object) -> None:
        if name == "sigma":
            rule = "is not stored, it has set the weights: make a new group with it, or set the weights"
            raise AttributeError(f"{self._label('sigma')}: {rule}", name=name)
        super().__setattr__(name, value)

    def __post_init__(self, sigma: ArrayLike | None) -> None:
        weighted = self.member_weights is not None or self.weight != 1.0
        self.validate()
        if sigma is None:
            return
        if weighted:
            raise InvalidArgument(f"{self._label('sigma')}: gives the weights: must be alone, without others")
        self._weigh(sigma)

    @property
    def num_members(self) -> int:
        """Number of members, n."""
        return len(self.cameras)

    def _check(self) -> None:
        kind = constraint_kind(self.kind)
        check_fields(self, "name", "loss")
        self.name = self.name or self.kind
        self.cameras = _cameras(self._label("cameras"), self.cameras, kind)
        count = len(self.cameras)
        self.values = self._values(kind, count)
        self.member_weights = self._member_weights(kind, count)
        self.points = self._points(kind, count)
        self.weight = self._number("weight", self.weight)
        if self.loss_scale is not None:
            self.loss_scale = self._number("loss_scale", self.loss_scale)

    def _weigh(self, sigma: ArrayLike) -> None:
        """Set both weights so that each error counts over its σ."""
        kind, label = constraint_kind(self.kind), self._label("sigma")
        given = number_array(label, sigma)
        if given.ndim == 0:
            require_positive(label, self._number("sigma", sigma))
        each = self._by_member(label, given if given.ndim else np.full(self.num_members, given), kind)
        if each.size and each.min() <= 0:
            raise InvalidArgument(f"{label} = {each.min():g}: must be positive")
        if kind.spread is None:  # as many as each member has points
            self.member_weights = np.array([len(x) for x in self.points]) / each**2
        elif given.ndim:
            self.weight, self.member_weights = kind.spread, 1 / each**2
        else:
            self.weight = kind.spread / float(given) ** 2

    def _by_member(self, label: str, values: FloatArray, kind: ConstraintKind) -> FloatArray:
        """A number for each member, or for each number of kinds whose values are vectors."""
        by_entry = values.ndim == 2 and kind.values is not None and len(kind.values) == 1
        count = self.num_members
        return finite_array(label, values, (count, *kind.values) if by_entry and kind.values else (count,))

    def _number(self, field_name: str, value: object) -> float:
        try:
            return float(value)  # type: ignore[arg-type]
        except (TypeError, ValueError):
            hint = "; solve(…, weight=…) chooses it from the data" if field_name == "weight" else ""
            raise InvalidArgument(f"{self._label(field_name)} = {value!r}: must be a number{hint}") from None

    def _values(self, kind: ConstraintKind, count: int) -> FloatArray | None:
        relative = self.cameras.ndim == 2 and 1 in kind.cameras
        if kind.values is None or relative:
            if self.values is None:
                return None
            what = "between two cameras " if relative else ""
            raise InvalidArgument(f"{self._label('values')}: kind {kind.name!r} {what}has none, must be None")
        if self.values is None:
            raise InvalidArgument(f"{self._label('values')}: missing, kind {kind.name!r} needs a measurement")
        return finite_array(self._label("values"), self.values, (count, *kind.values))

    def _member_weights(self, kind: ConstraintKind, count: int) -> FloatArray:
        if self.member_weights is None:
            return np.ones(count)
        label = self._label("member_weights")
        return self._by_member(label, number_array(label, self.member_weights), kind)

    def _points(self, kind: ConstraintKind, count: int) -> list[FloatArray]:
        if not isinstance(self.points, Sized):
            raise InvalidArgument(f"{self._label('points')} = {self.points!r}: must be a sequence of arrays")
        given = len(self.points)
        wanted = count if kind.compares_images else 0
        if given != wanted:
            raise InvalidArgument(
                f"{self._label('points')}: {given} arrays, "
                f"kind {kind.name!r} of {count} members needs {wanted}"
            )
        label = self._label("points")
        return [finite_array(f"{label}[{k}]", x, (ANY, 3)) for k, x in enumerate(self.points)]


def _table_of_kinds() -> str:
    """Table of the core's constraint kinds, for a docstring."""
    rows = [("kind", "values", "error", "frame of the values")]
    for kind in CONSTRAINT_KINDS.values():
        shape = "none" if kind.values is None else "(n" + "".join(f", {k}" for k in kind.values) + ")"
        rows.append((kind.name, shape.replace("(n)", "(n,)"), kind.error, kind.frame))
    widths = [max(map(_width, column)) for column in zip(*rows, strict=True)]
    ruler = ["=" * width for width in widths]
    lines = [ruler, rows[0], ruler, *rows[1:], ruler]
    return "\n    ".join("  ".join(map(_padded, line, widths)).rstrip() for line in lines)


def _padded(text: str, width: int) -> str:
    return text + " " * (width - _width(text))


def _width(text: str) -> int:
    """Columns that a text takes: hats have none of their own."""
    return sum(not combining(character) for character in text)


if ConstraintGroup.__doc__:  # not under python -OO
    ConstraintGroup.__doc__ = ConstraintGroup.__doc__.replace("{kinds}", _table_of_kinds())


def constraint_kind(name: str) -> ConstraintKind:
    """Look a kind of constraint up by name.

    Parameters
    ----------
    name : str
        One of the keys of `CONSTRAINT_KINDS`.

    Returns
    -------
    ConstraintKind
        What it measures.

    Raises
    ------
    InvalidArgument
        If there is no kind of that name.
    """
    return looked_up("kind", name, CONSTRAINT_KINDS)


def _cameras(label: str, value: ArrayLike, kind: ConstraintKind) -> IndexArray:
    array = number_array(label, value)
    if array.size == 0:
        array = np.zeros((0, 2) if kind.cameras == (2,) else 0, dtype=np.int32)
    if array.ndim not in kind.cameras or (array.ndim == 2 and array.shape[1] != 2):
        shapes = " or ".join("(any,)" if n == 1 else "(any, 2)" for n in kind.cameras)
        raise InvalidArgument(f"{label}: shape {array.shape}, must be {shapes} for kind {kind.name!r}")
    if not np.issubdtype(array.dtype, np.integer):
        raise InvalidArgument(f"{label}: dtype {array.dtype}, must be whole numbers")
    require_int32(label, array)
    return as_stored(array, np.int32)
