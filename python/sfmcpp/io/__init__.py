"""Files: problems read from and written to the formats of the field, in this package's conventions."""

from sfmcpp.io.api import convert, formats, read, write
from sfmcpp.io.format import Format
from sfmcpp.io.sba import read_sba

__all__ = ["Format", "convert", "formats", "read", "read_sba", "write"]
