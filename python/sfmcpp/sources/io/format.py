"""The description of a file format: its name, suffixes, functions and limits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from sfmcpp.ba.parts import Part
from sfmcpp.ba.ranks import Ranks
from sfmcpp.model import Problem
from sfmcpp.sources.io.files import COMPRESSED_SUFFIXES
from sfmcpp.sources.io.shares import Share

# What formats of geometry and pixels alone do not have.
GEOMETRY_ALONE = (
    "origin of the world",
    "keypoints without a point",
    "image names",
    "image sizes",
    "colours",
    "masks",
    "rigid frames",
)


@dataclass(frozen=True)
class Format:
    """A file format: its name, its suffixes, and how to read and write it.

    Attributes
    ----------
    name : str
        Name to ask for it by.
    description : str
        One line for people.
    suffixes : tuple of str
        How the names of its files end; empty for folders.
    reader, writer : callable or None
        How a path becomes a problem, and a problem a path; None: not readable, not writable.
    claim : callable or None
        Whether a file of an ambiguous name is of this format.
    share_reader : callable or None
        How one of several ranks reads some rows of a file that a single one need not hold; None where that
        file is not like that.
    part_reader, part_writer : callable or None
        How each of several ranks reads and writes its part alone.
    holds_every_model : bool
        Whether it can keep projection matrices and homogeneous points, and camera models that were built in.
    target_check : callable or None
        Raises a DatasetError if what is at a path must not be written over, by a problem or (None) by any.
    undistorts : bool
        Whether pixels are written as cameras without distortion would have seen them.
    lacks : tuple of str
        What of a problem its files do not have, by the names of :mod:`sfmcpp.sources.io.conversion_notes`.
    """

    name: str
    description: str
    suffixes: tuple[str, ...]
    reader: Callable[[Path], Problem] | None = field(default=None, repr=False)
    writer: Callable[[Problem, Path], None] | None = field(default=None, repr=False)
    claim: Callable[[Path], bool] | None = field(default=None, repr=False)
    share_reader: Callable[[Path, Ranks], Share | None] | None = field(default=None, repr=False)
    part_reader: Callable[[Path, Ranks], Part] | None = field(default=None, repr=False)
    part_writer: Callable[[Part, Path, Ranks], None] | None = field(default=None, repr=False)
    holds_every_model: bool = False
    target_check: Callable[[Path, Problem | None], None] | None = field(default=None, repr=False)
    undistorts: bool = False
    lacks: tuple[str, ...] = ()

    @property
    def readable(self) -> bool:
        """Whether files of this format can be read."""
        return self.reader is not None

    @property
    def writable(self) -> bool:
        """Whether files of this format can be written."""
        return self.writer is not None

    @property
    def compresses(self) -> bool:
        """Whether files are compressed where their name asks for it; names of folders ask for nothing."""
        return not self.suffixes or any(suffix.endswith(COMPRESSED_SUFFIXES) for suffix in self.suffixes)

    def claims(self, path: Path) -> bool:
        """Whether `path`, which need not exist, is a name for this format."""
        if self.claim is not None:
            return self.claim(path)
        return path.name.lower().endswith(self.suffixes)
