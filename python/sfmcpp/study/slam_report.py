"""Report of a SLAM run, measured against the truth."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, fields
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.model.process_state import peak_memory_bytes
from sfmcpp.slam.scale_drift import scale_sigmas, scale_text
from sfmcpp.study.evaluation import Evaluation, evaluate
from sfmcpp.study.report_files import plain
from sfmcpp.study.report_table import ReportTable, origin_text
from sfmcpp.weighting.conflict import CONFLICT_SIGMAS

if TYPE_CHECKING:
    from sfmcpp.slam import KeyframeRecord, SlamRun

_Ways = tuple[tuple[str, dict[str, Any]], ...]

# What an evaluation is asked for, and what legends say of it: what `evaluate` does by itself, and the next
# where one is not determined.
_ALIGNED: _Ways = (
    ("aligned to the whole trajectory", {"align_to": "all", "align_by": "positions"}),
    ("aligned to the whole trajectory, by poses", {"align_to": "all", "align_by": "poses"}),
)
_OWN_SCALE: _Ways = tuple((words, {**options, "with_scale": False}) for words, options in _ALIGNED)
_DRIFT: _Ways = (("aligned to the first tenth, by poses", {"align_to": "first:0.1", "align_by": "poses"}),)


class SlamReport(ReportTable):
    """Report of a SLAM run, as text, plain values and files.

    Parameters
    ----------
    run : SlamRun
        What :func:`sfmcpp.slam.run` returned.
    """

    def __init__(self, run: SlamRun) -> None:
        self.run = run

    @property
    def comparison(self) -> Evaluation | None:
        """The trajectory against the truth, as `evaluate` has it; None without truth, or if undetermined."""
        return self._measured[1]

    @cached_property
    def in_metres(self) -> Evaluation | None:
        """The comparison of a map in metres at its own scale; None of others, or if undetermined."""
        return self._evaluated(_OWN_SCALE)[1] if self.run.result.metric else None

    @cached_property
    def drift(self) -> Evaluation | None:
        """The comparison aligned by the first tenth alone; None of a map in the world of a GPS or an INS."""
        return None if self.run.georeferenced else self._evaluated(_DRIFT)[1]

    @cached_property
    def _scale_sigma(self) -> float | None:
        """Standard deviation of log(scale at the end / at the start); None where sensors hold the scale."""
        sigmas = scale_sigmas(self.run.result)
        return None if sigmas is None or not len(sigmas) else float(sigmas[-1])

    @property
    def alignment(self) -> str:
        """How the trajectory was brought to the truth for that, in words."""
        return self._measured[0]

    @cached_property
    def _measured(self) -> tuple[str, Evaluation | None]:
        return self._evaluated(_ALIGNED)

    def _evaluated(self, ways: _Ways) -> tuple[str, Evaluation | None]:
        """The first of the ways that is determined: what it is called, and the comparison by it."""
        run = self.run
        if run.drive.truth is None or run.world is None:
            return "", None
        for words, options in ways:
            try:
                return words, evaluate(run.trajectory(), run.drive.truth, **options)
            except InvalidArgument:
                continue
        return "", None

    def to_dict(self) -> dict[str, Any]:
        """All of it as plain values; what is not finite is None."""
        run, frames, result = self.run, self.run.drive.frames, self.run.result
        content = {
            "input": {
                "path": str(run.drive.path),
                "frames": len(frames),
                "tracks": frames.num_tracks,
                "corners": frames.corners,
                "assumed_fps": frames.assumed_fps,
                "right_images": frames.right_use and frames.right_use._asdict(),
            },
            "settings": asdict(run.settings),
            "sensors": run.sensors,
            "message": result.message,
            "interrupted": run.interrupted,
            "totals": run.totals,
            "fps": run.fps,
            "seconds_driven": run.driven_s,
            "real_time_factor": run.real_time_factor,
            "seconds": run.seconds,
            "seconds_read": run.drive.seconds_read,
            "seconds_tracking": frames.seconds,
            "peak_memory_bytes": peak_memory_bytes(),
            "bridged_frames": result.bridged,
            "lost_frames": result.lost,
            "restart_frames": result.restarts,
            "correction_frames": result.corrections,
            "metric": result.metric,
            "scale_sigma": self._scale_sigma,
            "origin": None if run.origin is None else run.origin.to_dict(),
            "final_adjustment": None if result.final is None else asdict(result.final),
            "warnings": result.warnings,
            "keyframes": [_keyframe_facts(record) for record in result.records],
            "truth": None if self.comparison is None else self.comparison.to_dict(),
            "truth_in_metres": None if self.in_metres is None else self.in_metres.to_dict(),
            "drift": None if self.drift is None else self.drift.to_dict(),
        }
        found: dict[str, Any] = plain(content)
        return found

    def write(self, folder: str | PathLike[str]) -> list[Path]:
        """Write trajectories, map, report, pictures and a page of the map; without a map the report alone.

        Parameters
        ----------
        folder : path-like
            Where to, made if missing; files of these names are replaced, others left alone.

        Returns
        -------
        list of Path
            What was written.

        Raises
        ------
        DatasetError
            If a file could not be written, the others are; or Matplotlib is not installed.
        """
        require_pictures(Path(folder))
        from sfmcpp.study.slam_files import write_files

        return write_files(self, Path(folder))

    def _rows(self) -> Iterator[tuple[str, str]]:
        run, count, comparison = self.run, self.run.totals, self.comparison
        frames = run.drive.frames
        yield "input", str(run.drive.path)
        yield "frames", f"{count['frames']:,} of {len(frames):,}, {count['poses']:,} with a pose"
        if frames.assumption is not None and not run.sensors:  # beside sensors it is a warning of the run
            yield "times", frames.assumption
        yield "of these", f"{count['bridged']:,} from the previous frame only, {count['lost']:,} predicted"
        yield "map", f"{count['keyframes']:,} keyframes, {count['points']:,} points"
        if run.world is not None and not run.result.metric:
            yield "scale", "arbitrary: metres come from an odometer, a GPS, an INS or --stereo"
        if self._scale_sigma is not None:
            told = scale_text(self._scale_sigma)
            yield "scale drift", f"{told} from start to end (standard deviation, by the images)"
        yield "seconds", f"{run.seconds:.3f} ({run.fps:.0f} frames/s), {self._stages()}"
        if run.real_time_factor is not None:
            drive = f"the drive, which took {run.driven_s:.4g} s"
            yield "real time", f"{run.real_time_factor:.3g} times as fast as {drive}"
        if frames.seconds is not None:
            each = 1e3 * frames.seconds / max(run.frames, 1)
            text = f"{frames.seconds:.3f} s for images and corners meanwhile, {each:.3g} ms per image"
            yield "images", text
        if frames.right_use is not None:
            used, corners = frames.right_use
            yield "right images", f"used in {used:,} of {run.frames:,} frames, {corners:.0f} corners in each"
        if run.result.final is not None:
            yield "final", run.result.final.describe()
        if run.sensors:
            yield "sensors", f"{', '.join(run.sensors)}; weights {self._weights()}"
            if run.drive.clock_offset_s:
                yield "clock", f"{run.drive.clock_offset_s:+.9g} s added to the time stamps of the sensors"
        if run.origin is not None:
            yield "origin", origin_text(run.origin)
        for name in run.sensors:
            yield from self._conflict(name)
        for warning in run.result.warnings:
            yield "warning", warning
        if comparison is not None:
            error, length = comparison.mean_3d_error_m, comparison.truth.length_m
            scale = comparison.alignment.similarity.scale
            yield "mean 3-D error", f"{error:.4g} m of {length:.4g} m, {self.alignment}, scale {scale:.4g}"
            if comparison.warning:
                yield "warning", comparison.warning
        if self.in_metres is not None:
            yield "in metres", f"{self.in_metres.mean_3d_error_m:.4g} m, with its own scale"
        if self.drift is not None:
            yield "drift", f"{self.drift.mean_3d_error_m:.4g} m, {_DRIFT[0][0]}"

    def _stages(self) -> str:
        """Mean milliseconds of each stage of a keyframe."""
        records = self.run.result.records
        names = dict.fromkeys(name for record in records for name in record.milliseconds)
        means = {name: np.mean([r.milliseconds.get(name, 0.0) for r in records]) for name in names}
        listed = ", ".join(f"{name} {mean:.2g}" for name, mean in means.items())
        return f"ms per keyframe: {listed}" if listed else "no keyframe after the start"

    def _weights(self) -> str:
        """How they were chosen, and the median for each sensor."""
        records = self.run.result.records
        found = {name: [r.weights[name] for r in records if name in r.weights] for name in self.run.sensors}
        medians = [f"{name} {np.median(values):.3g}" for name, values in found.items() if values]
        rule = f"by {self.run.settings.weights}"
        return f"{rule}, median {', '.join(medians)}" if medians else rule

    def _conflict(self, name: str) -> Iterator[tuple[str, str]]:
        """Text on where a sensor disagrees with the images, and by how much."""
        sigmas_of_keyframes = [r.conflicts[name] for r in self.run.result.records if name in r.conflicts]
        worse = [sigmas for sigmas in sigmas_of_keyframes if sigmas > CONFLICT_SIGMAS]
        if worse:
            where = f"at {len(worse):,} of {len(sigmas_of_keyframes):,} keyframes"
            yield "conflict", f"{name} disagrees with the images {where}, by up to {max(worse):.1f} σ"


def require_pictures(folder: Path) -> None:
    """Raise a DatasetError, which names the folder of a run, if no picture can be drawn."""
    try:
        import sfmcpp.study.plotting  # noqa: F401
    except ModuleNotFoundError as error:
        reason = f"its trajectory.png needs {error.name}: pip install 'sfmcpp[plot]'"
        raise DatasetError(folder, reason) from None


def _keyframe_facts(record: KeyframeRecord) -> dict[str, Any]:
    """All of a record but the curves that the weights were chosen from: a hundred numbers each."""
    return {f.name: getattr(record, f.name) for f in fields(record) if f.name != "selections"}
