"""Refinement of a metric model: outliers left out, tracks of one point merged, also around a loop."""

from __future__ import annotations

from dataclasses import replace

from sfmcpp.sfm.batch.metric_model import AdjustmentPlan, MetricModel

_ROUNDS = 3
# Tolerances of merging, in multiples of the largest error of an observation: wide at first, as what has
# drifted lies beside itself, then as narrow as the errors are.
_TOLERANCES = (1.5, 0.75, 0.4)
# The last tolerance, in multiples of the error from which on an observation is an outlier.
_NARROWEST = 2.0
# Share by which the errors of tracks that were not merged may grow where others are.
_TOLERATED_GROWTH = 0.25


def refine(model: MetricModel, plan: AdjustmentPlan) -> None:
    """Adjust a model and leave out outliers, in turn.

    Parameters
    ----------
    model : MetricModel
        Changed in place; any observation may come back.
    plan : AdjustmentPlan
        What is free and what counts.
    """
    for _ in range(_ROUNDS):
        _choose(model, plan)
        if not model.counts.any():
            return
        model.adjust(plan, loss="cauchy")
    model.leave_out_outliers(plan.max_error_px, plan.min_views)


def close_gaps(model: MetricModel, plan: AdjustmentPlan) -> int:
    """Merge tracks of one point and adjust, in turn; as it was before where this spoils the other tracks.

    Every round starts with the tracks that were given, so that what was merged wrongly with a wide tolerance
    does not stay.

    Parameters
    ----------
    model : MetricModel
        A refined one, changed in place.
    plan : AdjustmentPlan
        What is free and what counts.

    Returns
    -------
    int
        How many points there are fewer.
    """
    if not model.counts.any():
        return 0
    before, tracks = model.copy(), model.problem.point_index.copy()
    narrow = _NARROWEST * model.outlier_limit_px(plan.max_error_px)
    # Two tracks of two views may be one of four.
    short = replace(plan, min_views=2)
    wide = [share * plan.max_error_px for share in _TOLERANCES]
    for tolerance in [*(t for t in wide if t > narrow), narrow]:
        _choose(model, short)
        model.merge(tolerance)
        model.triangulate()
        model.leave_out_behind(short.min_views)
        model.adjust(plan, loss="cauchy")
        model.problem.point_index[:] = tracks
    _choose(model, short)
    limit = plan.max_error_px
    if model.truncated_cost(limit) > (1 + _TOLERATED_GROWTH) * before.truncated_cost(limit) + 1e-12:
        model.problem, model.counts = before.problem, before.counts
        return 0
    fewer = model.merge(narrow)
    model.triangulate()
    model.leave_out_outliers(plan.max_error_px, plan.min_views)
    model.adjust(plan, loss="cauchy")
    model.leave_out_outliers(plan.max_error_px, plan.min_views)
    return fewer


def _choose(model: MetricModel, plan: AdjustmentPlan) -> None:
    """Triangulate all points anew and let count what agrees."""
    model.triangulate_robustly(plan.max_error_px, plan.min_views)
    model.leave_out_outliers(plan.max_error_px, plan.min_views)
