"""`report.json` and the table of a SLAM run."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np

from sfmcpp.cli.report import peak_memory_bytes
from sfmcpp.cli.slam_images import ImageStream
from sfmcpp.cli.slam_input import SlamInput
from sfmcpp.cli.slam_job import Measured, SlamJob
from sfmcpp.errors import InvalidArgument
from sfmcpp.model import Trajectory
from sfmcpp.slam import KeyframeRecord
from sfmcpp.study.evaluation import Evaluation, evaluate
from sfmcpp.weighting.conflict import CONFLICT_SIGMAS

# How a trajectory is registered to the truth, and what legends say; the next where one is not determined.
ALIGNMENTS = {"first:0.1": "aligned to its first tenth", "all": "aligned to all of it"}


def compare(trajectory: Trajectory, truth: Trajectory | None) -> Evaluation | None:
    """Measure a trajectory against the truth; None without truth, or if it does not determine the scale."""
    if truth is None:
        return None
    for rule in ALIGNMENTS:
        try:
            return evaluate(trajectory, truth, align_to=rule, align_by="poses")
        except InvalidArgument:
            continue
    return None


def make_report(
    job: SlamJob, given: SlamInput, measured: Measured, comparison: Evaluation | None
) -> dict[str, Any]:
    """Build the report: plain values; what is not finite is None."""
    result = measured.result
    report = {
        "input": _input(job, given),
        "settings": asdict(job.settings),
        "sensors": list(job.sensors),
        "message": result.message,
        "interrupted": measured.interrupted,
        "totals": totals(measured),
        "fps": measured.fps,
        "seconds": measured.seconds,
        "seconds_read": measured.seconds_read,
        "seconds_tracking": measured.seconds_tracking,
        "peak_memory_bytes": peak_memory_bytes(),
        "bridged_frames": list(result.bridged),
        "lost_frames": list(result.lost),
        "restart_frames": list(result.restarts),
        "correction_frames": list(result.corrections),
        "metric": result.metric,
        "warnings": list(result.warnings),
        "keyframes": [_keyframe(record) for record in result.records],
        "truth": None if comparison is None else comparison.to_dict(),
    }
    plain: dict[str, Any] = _plain(report)
    return plain


def _input(job: SlamJob, given: SlamInput) -> dict[str, Any]:
    frames = given.frames
    corners = job.images.corners if isinstance(frames, ImageStream) else None
    return {
        "path": str(job.source),
        "frames": len(frames),
        "tracks": frames.num_tracks,
        "corners": corners,
    }


def _keyframe(record: KeyframeRecord) -> dict[str, Any]:
    """All but the curves that the weights were chosen from: a hundred numbers each."""
    return {f.name: getattr(record, f.name) for f in fields(record) if f.name != "selections"}


def totals(measured: Measured) -> dict[str, int]:
    """Count what a run gave."""
    result = measured.result
    world = result.world
    return {
        "frames": measured.frames,
        "poses": len(result.poses),
        "bridged": len(result.bridged),
        "lost": len(result.lost),
        "keyframes": 0 if world is None else len(world.keyframes),
        "points": 0 if world is None else int(np.count_nonzero(world.known)),
    }


def lines_of(
    job: SlamJob,
    given: SlamInput,
    measured: Measured,
    comparison: Evaluation | None,
    written: Iterable[Path],
) -> list[str]:
    """Lines of the table at the end."""
    count = totals(measured)
    lines = [
        _line("input", str(job.source)),
        _line("frames", f"{count['frames']:,} of {len(given.frames):,}, {count['poses']:,} with a pose"),
        _line("of these", f"{count['bridged']:,} from the frame before alone, {count['lost']:,} predicted"),
        _line("map", f"{count['keyframes']:,} keyframes, {count['points']:,} points"),
        _line("seconds", f"{measured.seconds:.3f} ({measured.fps:.0f} frames/s), {_stages(measured)}"),
        *_tracking(measured),
    ]
    if job.sensors:
        lines.append(_line("sensors", f"{', '.join(job.sensors)}; weights {_weights(job, measured)}"))
    lines += [_line("conflict", conflict) for conflict in _conflicts(job, measured)]
    lines += [_line("warning", warning) for warning in measured.result.warnings]
    if comparison is not None:
        rule = ALIGNMENTS[str(comparison.alignment.rule)]
        error, length = comparison.mean_3d_error_m, comparison.truth.length_m
        lines.append(_line("mean 3-D error", f"{error:.4g} m of {length:.4g} m, {rule}"))
    return lines + [_line("written", str(path)) for path in written]


def _stages(measured: Measured) -> str:
    """Mean milliseconds of each stage of a keyframe."""
    records = measured.result.records
    names = dict.fromkeys(name for record in records for name in record.milliseconds)
    means = {name: np.mean([r.milliseconds.get(name, 0.0) for r in records]) for name in names}
    listed = ", ".join(f"{name} {mean:.2g}" for name, mean in means.items())
    return f"ms a keyframe: {listed}" if listed else "no keyframe after the start"


def _tracking(measured: Measured) -> list[str]:
    """How much of the time the images took."""
    seconds = measured.seconds_tracking
    if seconds is None:
        return []
    each = 1e3 * seconds / max(measured.frames, 1)
    return [_line("images", f"{seconds:.3f} of these seconds with their corners, {each:.3g} ms an image")]


def _weights(job: SlamJob, measured: Measured) -> str:
    """How they were chosen, and the median for each sensor."""
    found = {
        name: [r.weights[name] for r in measured.result.records if name in r.weights] for name in job.sensors
    }
    medians = [f"{name} {np.median(values):.3g}" for name, values in found.items() if values]
    return f"by {job.settings.weights}" + (f", in the median {', '.join(medians)}" if medians else "")


def _conflicts(job: SlamJob, measured: Measured) -> list[str]:
    """Sensors that disagree with the images: where, and by how much."""
    lines = []
    for name in job.sensors:
        told = [r.conflicts[name] for r in measured.result.records if name in r.conflicts]
        worse = [sigmas for sigmas in told if sigmas > CONFLICT_SIGMAS]
        if worse:
            where = f"at {len(worse):,} of {len(told):,} keyframes"
            lines.append(f"{name} disagrees with the images {where}, by up to {max(worse):.1f} σ")
    return lines


def _line(name: str, value: str) -> str:
    return f"{name:<16}{value}"


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(name): _plain(member) for name, member in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, list | tuple):
        return [_plain(member) for member in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
