"""The numbers that steer how corners are found and followed."""

from __future__ import annotations

from dataclasses import dataclass

from sfmcpp.errors import InvalidArgument

# What a corner is.
CORNERS = ("shi-tomasi", "harris")


@dataclass(frozen=True)
class KltSettings:
    """What decides about corners and how they are followed.

    Attributes
    ----------
    corners : str
        ``"shi-tomasi"`` or ``"harris"``.
    columns, rows : int
        Cells of the grid across and down the image.
    per_cell : int
        Tracks that a cell is filled up to.
    window_px : int
        Side of the square that is compared, odd [px].
    levels : int
        Halvings of the image above the full size; each doubles the motion that can be followed.
    forward_backward_px : float
        Farthest that a corner may come back from where it started [px].
    min_distance_px : int
        Least distance of a new corner from all others [px].
    quality : float
        Least response of a corner, as part of the strongest one's in the image; that of Harris goes with
        the square of the eigenvalues, and is compared with the square of this.
    max_residual : float
        Largest mean absolute difference of the two squares [grey levels].
    """

    corners: str = "shi-tomasi"
    columns: int = 12
    rows: int = 4
    per_cell: int = 5
    window_px: int = 21
    levels: int = 4
    forward_backward_px: float = 1.0
    min_distance_px: int = 10
    quality: float = 0.01
    max_residual: float = 40.0

    def __post_init__(self) -> None:
        if self.corners not in CORNERS:
            raise InvalidArgument(f"corners = {self.corners!r}: must be one of {', '.join(CORNERS)}")
        for name in ("columns", "rows", "per_cell", "min_distance_px"):
            _require(name, getattr(self, name), getattr(self, name) >= 1, "at least 1")
        for name in ("forward_backward_px", "max_residual"):
            _require(name, getattr(self, name), getattr(self, name) > 0, "positive")
        _require("window_px", self.window_px, self.window_px in range(3, 256, 2), "odd, from 3 to 255")
        _require("levels", self.levels, self.levels >= 0, "0 or more")
        _require("quality", self.quality, 0 < self.quality < 1, "in (0, 1)")


def _require(name: str, value: float, good: bool, rule: str) -> None:
    if not good:
        raise InvalidArgument(f"{name} = {value}: must be {rule}")
