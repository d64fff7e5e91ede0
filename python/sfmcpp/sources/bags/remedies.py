"""What to do with bags of recordings that were not closed, as after a crash or on a full disk."""

from __future__ import annotations

from pathlib import Path

from sfmcpp.sources.io.files import is_folder

_OF_DAMAGED = {
    ".bag": "`rosbag reindex` mends one that was not closed",
    ".mcap": "`mcap recover` saves what is whole of one that was not closed",
    ".db3": "`sqlite3 FILE .recover | sqlite3 NEW` saves what is whole",
}
_UNCLOSED = ".active"  # ROS 1 takes it off the name when it closes a bag


def for_damaged(path: Path) -> str:
    """What saves a bag that was not closed, or nothing where none is known; for the end of a message.

    Parameters
    ----------
    path : Path
        A file, or a folder of ROS 2.
    """
    files = _data_files(path) if is_folder(path) else [path]
    return next((f"; {_OF_DAMAGED[f.suffix]}" for f in files if f.suffix in _OF_DAMAGED), "")


def for_no_bag(path: Path) -> str:
    """What makes a bag of what is none by its name or its contents, or nothing; for the end of a message."""
    if is_folder(path):
        files = _data_files(path)
        if files:
            made = f"`ros2 bag reindex {path.name}` makes one"
            return f"; it holds {files[0].name}, which can be given itself, and no metadata.yaml: {made}"
        return ""
    if path.suffix == _UNCLOSED:
        return "; ROS was still writing it: rename it to *.bag, and `rosbag reindex` mends it"
    return ""


def _data_files(folder: Path) -> list[Path]:
    return sorted(file for file in folder.iterdir() if file.suffix in _OF_DAMAGED)
