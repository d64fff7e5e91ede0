"""What a SLAM run is asked for, and what it gives."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from sfmcpp.slam import SlamResult, SlamSettings
from sfmcpp.sources.vision import CORNERS


@dataclass(frozen=True)
class ImageOptions:
    """What the user says of images that the files beside them do not.

    Attributes
    ----------
    intrinsics : tuple of five float, or None
        ``(f, aspect, cx, cy, skew)``.
    fps : float or None
        Frames per second.
    corners : str
        What is followed, one of :data:`sfmcpp.sources.vision.CORNERS`.
    """

    intrinsics: tuple[float, ...] | None = None
    fps: float | None = None
    corners: str = CORNERS[0]

    @property
    def given(self) -> bool:
        """Whether the user said anything."""
        return self != ImageOptions()


@dataclass(frozen=True)
class SlamJob:
    """One run as asked for on the command line; names as there."""

    source: Path
    output: Path
    settings: SlamSettings
    sensors: tuple[str, ...] = ()
    sensor_file: Path | None = None
    mounting: str | None = None
    view: bool = False
    quiet: bool = False
    images: ImageOptions = ImageOptions()


@dataclass(frozen=True, eq=False)
class Measured:
    """What a run gave.

    Attributes
    ----------
    result : SlamResult
        The map and the poses.
    frames : int
        Frames looked at.
    seconds, seconds_read : float
        Of the run, and of reading the input before [s].
    interrupted : bool
        Whether Ctrl-C ended it.
    seconds_tracking : float or None
        Of the run, for reading images and following their corners [s]; None for an input of tracks.
    """

    result: SlamResult
    frames: int
    seconds: float
    seconds_read: float
    interrupted: bool
    seconds_tracking: float | None = None

    @property
    def fps(self) -> float:
        """Frames looked at per second."""
        return self.frames / self.seconds if self.seconds > 0 else math.inf
