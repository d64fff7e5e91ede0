"""The kinds of experiments, one line each: a new kind is a module with a function and a line here."""

from __future__ import annotations

from collections.abc import Callable

from experiments.absolute_stop import convergence_in_the_thesis_unknowns
from experiments.acceptance import acceptance_rate
from experiments.basin import basin_of_convergence
from experiments.batch_success import share_of_metric_success
from experiments.convergence import mean_convergence
from experiments.courses import courses_of_drives
from experiments.description import Experiment
from experiments.drives import sensors_on_drives
from experiments.factorisation import share_of_success
from experiments.keyframe_weights import criteria_over_weights, weights_at_keyframes
from experiments.lengths import proposed_lengths
from experiments.orientations import constant_weights_of_orientations, methods_with_orientations
from experiments.real_curves import rms_from_real_starts
from experiments.real_data import real_problems
from experiments.report import Report
from experiments.rms_curves import mean_rms
from experiments.roots import number_of_roots
from experiments.scale import searches_at_scale
from experiments.selection_time import time_to_choose
from experiments.step_line import costs_along_steps
from experiments.step_plane import costs_over_lengths
from experiments.trade_offs import trade_off_criteria
from experiments.whole_weights import whole_weights

KINDS: dict[str, Callable[[Experiment], Report]] = {
    "absolute-stop": convergence_in_the_thesis_unknowns,
    "acceptance": acceptance_rate,
    "basin": basin_of_convergence,
    "batch-success": share_of_metric_success,
    "constant-orientations": constant_weights_of_orientations,
    "convergence": mean_convergence,
    "courses": courses_of_drives,
    "criteria": criteria_over_weights,
    "drives": sensors_on_drives,
    "factorisation": share_of_success,
    "keyframe-weights": weights_at_keyframes,
    "lengths": proposed_lengths,
    "orientations": methods_with_orientations,
    "real": real_problems,
    "real-curves": rms_from_real_starts,
    "rms-curves": mean_rms,
    "roots": number_of_roots,
    "scale": searches_at_scale,
    "selection-time": time_to_choose,
    "step-line": costs_along_steps,
    "step-plane": costs_over_lengths,
    "trade-offs": trade_off_criteria,
    "whole-weights": whole_weights,
}
