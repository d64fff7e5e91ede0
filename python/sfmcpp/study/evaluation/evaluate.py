"""Evaluation of a trajectory: all measures at once."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from sfmcpp.model import Trajectory
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import FloatArray
from sfmcpp.study.evaluation.align import Alignment, AlignmentRule, align
from sfmcpp.study.evaluation.associate import associate, warning_of_few
from sfmcpp.study.evaluation.metrics import Errors, Statistics, ape, mean_3d_error, rpe, scale_ratios
from sfmcpp.study.evaluation.turned import warning_of_turned


@dataclass(frozen=True, eq=False, repr=False)
class Evaluation:
    """A trajectory measured against the truth; n pairs of poses.

    Attributes
    ----------
    estimate, truth : Trajectory
        The pairs, the estimate aligned.
    alignment : Alignment
        How it was aligned.
    mean_3d_error_m : float
        Mean distance of the positions, thesis eq. 5.24 [m].
    scale_ratios : (k,) float64
        Estimated over true length of each step, thesis eq. 5.25.
    ape, rpe : dict of str to float64 arrays
        Errors by the names of evo.
    rpe_delta : tuple of float and str
        Over what the relative errors are, such as ``(1.0, "frames")``.
    warning : str
        Warning where most poses have no partner, or orientations are of another body or were misread; empty
        otherwise. The alignment has its own.
    """

    estimate: Trajectory
    truth: Trajectory
    alignment: Alignment
    mean_3d_error_m: float
    scale_ratios: FloatArray
    ape: Errors
    rpe: Errors
    rpe_delta: tuple[float, str]
    warning: str = ""

    def __repr__(self) -> str:
        how = "aligned with scale" if self.alignment.with_scale else "aligned"
        errors = f"mean 3-D error {self.mean_3d_error_m:.6g} m, of {self.truth.length_m:.6g} m"
        return f"Evaluation({len(self.estimate)} pairs of poses, {how}: {errors})"

    @property
    def scale_ratio(self) -> Statistics | None:
        """Statistics of the scale ratios; None if the truth does not move."""
        return Statistics.of(self.scale_ratios) if len(self.scale_ratios) else None

    def to_dict(self) -> dict[str, Any]:
        """Everything but the trajectories, as plain values."""
        scale = self.scale_ratio
        return {
            "matched_poses": len(self.estimate),
            "warning": self.warning or None,
            "estimate_length_m": self.estimate.length_m,
            "truth_length_m": self.truth.length_m,
            "alignment": self.alignment.to_dict(),
            "mean_3d_error_m": self.mean_3d_error_m,
            "scale_ratio": None if scale is None else asdict(scale),
            "ape": _statistics(self.ape),
            "rpe": {"delta": self.rpe_delta[0], "delta_unit": self.rpe_delta[1], **_statistics(self.rpe)},
        }


@checked()
def evaluate(
    estimate: Trajectory,
    truth: Trajectory,
    *,
    align_to: str = "all",
    with_scale: bool = True,
    align_by: str = "positions",
    match: str = "nearest",
    max_difference_s: float | None = None,
    delta: float = 1.0,
    delta_unit: str = "frames",
    all_pairs: bool = False,
) -> Evaluation:
    """Measure a trajectory against the truth.

    Parameters
    ----------
    estimate, truth : Trajectory
        The two, in any frames and, with `with_scale`, at any scale.
    align_to : str
        ``"all"``, ``"none"``, ``"first:0.1"`` or ``"first:20"``; see :class:`AlignmentRule`.
    with_scale : bool
        Whether the alignment changes the scale.
    align_by : str
        ``"positions"`` or ``"poses"``; see :func:`align`.
    match, max_difference_s
        See :func:`associate`.
    delta, delta_unit, all_pairs
        See :func:`rpe`.

    Returns
    -------
    Evaluation

    Raises
    ------
    InvalidArgument
        If an option breaks its rule, nothing matches, or the poses do not determine the alignment.
    """
    rule = AlignmentRule.parse(align_to)
    pairs = associate(estimate, truth, match, max_difference_s)
    aligned, alignment = align(pairs, rule, with_scale, align_by)
    ours, true = aligned.poses, pairs.truth.poses
    warnings = (
        warning_of_few(estimate, truth, len(pairs), match),
        warning_of_turned(pairs.estimate.rotations, aligned.rotations, pairs.truth.rotations),
    )
    return Evaluation(
        aligned,
        pairs.truth,
        alignment,
        mean_3d_error(ours, true),
        scale_ratios(ours, true),
        ape(ours, true),
        rpe(ours, true, delta, delta_unit, all_pairs),
        (float(delta), delta_unit),
        "; ".join(filter(None, warnings)),
    )


def _statistics(errors: Errors) -> dict[str, dict[str, float]]:
    return {relation: asdict(Statistics.of(values)) for relation, values in errors.items()}
