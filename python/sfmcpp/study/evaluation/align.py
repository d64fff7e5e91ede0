"""Alignment of an estimated trajectory to the truth."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry.similarity import Similarity, fit_pose_similarity, fit_similarity
from sfmcpp.model import Trajectory
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.checks import require_one_of
from sfmcpp.study.evaluation.associate import Matched

ALIGN_BY = ("positions", "poses")
# Positions thinner than this, across over along, hardly tell the rotation about their line.
STRAIGHT = 0.05
_FEWEST = 3


@dataclass(frozen=True)
class AlignmentRule:
    """Which pairs an alignment is fitted to.

    Attributes
    ----------
    mode : str
        ``"first"``, ``"all"`` or ``"none"``; of models ``"robust"`` too: those that agree.
    amount : float
        For ``"first"``: a share of the pairs if below 1, else their number.
    """

    mode: str
    amount: float = 0.0

    @classmethod
    def parse(cls, text: str) -> AlignmentRule:
        """Understand ``"all"``, ``"none"``, ``"first:0.1"`` (the first tenth, rounded up) or ``"first:20"``.

        Raises
        ------
        InvalidArgument
            If `text` is none of these.
        """
        if text in ("all", "none"):
            return cls(text)
        if text == "robust":
            raise InvalidArgument("align = 'robust': is for models, must be all, none or first:N here")
        mode, _, amount = text.partition(":")
        try:
            value = float(amount)
        except ValueError:
            value = math.nan
        if mode != "first" or not (0 < value < 1 or (value >= _FEWEST and value.is_integer())):
            raise InvalidArgument(
                f"align = {text!r}: must be all, none, first:SHARE with a share below 1, or first:COUNT with "
                f"a count of {_FEWEST} or more"
            )
        return cls(mode, value)

    def count(self, pairs: int) -> int:
        """How many of the first `pairs` are used; a share is rounded up, and three are the fewest."""
        if self.mode != "first":
            return pairs if self.mode == "all" else 0
        # Rounded before it is rounded up: 0.07 times 100 is a little above 7 in binary.
        wanted = math.ceil(round(self.amount * pairs, 9)) if self.amount < 1 else int(self.amount)
        return min(pairs, max(wanted, _FEWEST))

    def __str__(self) -> str:
        return f"first:{self.amount:g}" if self.mode == "first" else self.mode


@dataclass(frozen=True, eq=False)
class Alignment:
    """A similarity truth_from_estimate, and what it was fitted to.

    Attributes
    ----------
    rule : AlignmentRule
        What was asked for.
    by : str
        ``"positions"`` or ``"poses"``.
    with_scale : bool
        Whether the scale was fitted too.
    similarity : Similarity
        What was applied.
    count : int
        Number of pairs it was fitted to.
    thinness : float
        Extent of these positions across their main direction over that along it: 0 on a straight line.
    """

    rule: AlignmentRule
    by: str
    with_scale: bool
    similarity: Similarity
    count: int
    thinness: float

    @property
    def warning(self) -> str:
        """Warning if the alignment is doubtful; empty otherwise."""
        if not self.count or self.by == "poses" or self.thinness >= STRAIGHT:
            return ""
        return (
            f"the {self.count} positions aligned run straight to within {100 * self.thinness:.2g} % of their "
            "length: the rotation about their line is hardly determined; align by poses (--align-by poses)"
            f"{self._hint_all}"
        )

    @property
    def _hint_all(self) -> str:
        return "" if str(self.rule) == "all" else ", or all"

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain values."""
        return {
            "rule": str(self.rule),
            "by": self.by,
            "with_scale": self.with_scale,
            "pairs": self.count,
            "thinness": self.thinness,
            "warning": self.warning or None,
            "scale": self.similarity.scale,
            "rotation": np.asarray(self.similarity.rotation).tolist(),
            "translation_m": np.asarray(self.similarity.translation).tolist(),
        }


@checked()
def align(
    pairs: Matched, rule: AlignmentRule, with_scale: bool = True, by: str = "positions"
) -> tuple[Trajectory, Alignment]:
    """Move an estimated trajectory to where it fits the truth best.

    Parameters
    ----------
    pairs : Matched
        Estimated and true poses.
    rule : AlignmentRule
        Which pairs to fit: the thesis (§5.4.1) takes the first five, evo all.
    with_scale : bool
        A similarity if true, else a rigid motion.
    by : str
        ``"positions"``: least squares over the positions, as the thesis and evo do. ``"poses"``: the
        orientations too, which also holds on a straight line (see :func:`fit_pose_similarity`).

    Returns
    -------
    aligned : Trajectory
        All estimated poses, in the frame of the truth.
    alignment : Alignment
        How they got there.

    Raises
    ------
    InvalidArgument
        If `by` is unknown, there are too few pairs, or their positions do not determine the alignment.
    """
    count = rule.count(len(pairs))
    source, target = pairs.estimate.poses, pairs.truth.poses
    alignment = fit_alignment(source[:count], target[:count], rule, with_scale, by)
    return pairs.estimate.with_poses(alignment.similarity.apply_to_poses(source)), alignment


def fit_alignment(
    source: FloatArray,
    target: FloatArray,
    rule: AlignmentRule,
    with_scale: bool,
    by: str,
) -> Alignment:
    """Fit the similarity of some pairs of poses; nothing moves where there are none.

    Parameters
    ----------
    source, target : (n, 3, 4) float64
        Estimated and true poses that `rule` chose.
    rule, with_scale, by
        See :func:`align`.

    Returns
    -------
    Alignment

    Raises
    ------
    InvalidArgument
        As :func:`align`.
    """
    require_one_of("by", by, ALIGN_BY)
    count = len(source)
    similarity = _fitted_alignment(source, target, with_scale, by) if count else Similarity.identity()
    thinness = min(_extent_ratio(poses[:, :, 3]) for poses in (source, target)) if count else 0.0
    return Alignment(rule, by, with_scale and count > 0, similarity, count, thinness)


def _fitted_alignment(source: FloatArray, target: FloatArray, with_scale: bool, by: str) -> Similarity:
    if by == "poses":
        return fit_pose_similarity(source, target, with_scale=with_scale)
    return fit_similarity(source[:, :, 3], target[:, :, 3], with_scale=with_scale)


def _extent_ratio(positions: FloatArray) -> float:
    extents = np.linalg.svd(positions - positions.mean(axis=0), compute_uv=False)
    return float(extents[1] / extents[0]) if len(extents) > 1 and extents[0] > 0 else 0.0
