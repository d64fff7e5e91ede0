"""Checkpoints of a run: the loop between two frames, and what it was run on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from sfmcpp.ba.checkpoints import CheckpointStore, RunCheckpoints, digest, facts_of_run
from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.map.table import Table
from sfmcpp.map.tracks import Tracks
from sfmcpp.model import Gap
from sfmcpp.model.flattening import flatten, unflatten
from sfmcpp.model.frames import Frame, RightView, View
from sfmcpp.model.weight_selection import ConflictReport, WeightSelection
from sfmcpp.sensors import Turn
from sfmcpp.slam.experience import Experience
from sfmcpp.slam.result import FinalAdjustment, KeyframeRecord, Path, SlamResult
from sfmcpp.slam.sensing import Measurement, MotionSensor
from sfmcpp.slam.settings import SlamSettings
from sfmcpp.slam.world_map import Keyframe, WeightedMeasurement, WorldMap
from sfmcpp.sources.frames import FrameSource

_CLASSES = (
    ConflictReport,
    Experience,
    FinalAdjustment,
    Frame,
    Gap,
    Keyframe,
    KeyframeRecord,
    Measurement,
    Path,
    RightView,
    SlamResult,
    Table,
    Tracks,
    Turn,
    View,
    WeightSelection,
    WeightedMeasurement,
    WorldMap,
)

State = dict[str, Any]


class SlamCheckpoints:
    """Where a run over frames stands, saved and taken up.

    Parameters
    ----------
    save, resume : CheckpointStore, optional
        Where to save, and where to take up.
    source : FrameSource
        What the camera sees.
    settings : SlamSettings
        What steers the run.
    sensors : sequence of MotionSensor
        What measures the motion beside the camera.

    Raises
    ------
    DatasetError
        If `resume` has no checkpoint of this run, or `save` cannot be written.
    """

    def __init__(
        self,
        save: CheckpointStore | None,
        resume: CheckpointStore | None,
        source: FrameSource,
        settings: SlamSettings,
        sensors: Sequence[MotionSensor],
    ) -> None:
        self._run = RunCheckpoints(save, resume, lambda: _facts(source, settings, sensors))
        self._last: Frame | None = None

    def resumed(self) -> State | None:
        """State of the loop that was saved, if there is one."""
        taken = self._run.taken
        if taken is None:
            return None
        try:
            last, state = unflatten(taken.arrays, _CLASSES)
        except (InvalidArgument, ValueError) as error:
            raise DatasetError(taken.path, f"is no checkpoint of a run over frames: {error}") from error
        self._last = last
        return dict(state)

    def has_passed(self, frame: Frame) -> bool:
        """Whether the saved run took a frame; DatasetError if it was another one."""
        last, taken = self._last, self._run.taken
        if last is None or taken is None or frame.number > last.number:
            return False
        if frame.number == last.number and not _same(frame, last):
            raise DatasetError(taken.path, f"is of other images: frame {frame.number} sees something else")
        return True

    def offer(self, frame: Frame, state: State, last: bool) -> None:
        """Save the state of the loop after a frame, if it is time, or the run ends there."""
        self._run.offer(lambda: flatten((frame, state)), last)

    @property
    def warnings(self) -> list[str]:
        """What went wrong with them."""
        return self._run.warnings


def _facts(source: FrameSource, settings: SlamSettings, sensors: Sequence[MotionSensor]) -> dict[str, Any]:
    digests = {f"frames: {name}": digest(value) for name, value in source.identity().items()}
    digests |= {f"sensor {sensor.name!r}": digest(flatten(sensor)) for sensor in sensors}
    return facts_of_run("slam", problem=digests, options=asdict(settings))


def _same(a: Frame, b: Frame) -> bool:
    return (
        a.t_s == b.t_s
        and np.array_equal(a.view.tracks, b.view.tracks)
        and np.array_equal(a.view.pixels, b.view.pixels)
    )
