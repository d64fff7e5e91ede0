"""Files: problems read from and written to the formats of the field, in this package's conventions."""

from sfmcpp.sources.io.api import convert, formats, read, write
from sfmcpp.sources.io.checkpoints import CheckpointFolder
from sfmcpp.sources.io.colmap import from_pycolmap, to_pycolmap
from sfmcpp.sources.io.control_points import ControlPoints, Mark, read_control_points
from sfmcpp.sources.io.format import Format
from sfmcpp.sources.io.sba import read_sba

__all__ = [
    "CheckpointFolder",
    "ControlPoints",
    "Format",
    "Mark",
    "convert",
    "formats",
    "from_pycolmap",
    "read",
    "read_control_points",
    "read_sba",
    "to_pycolmap",
    "write",
]
