"""Whose positions they are: names in tables beside names of images."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator
from pathlib import PurePath, PureWindowsPath

from sfmcpp.errors import InvalidArgument


def named_alike(images: Iterable[str], told: Iterable[str]) -> dict[str, str]:
    """Find for each image the name that a table has for it.

    It is the same; else it may have more or fewer folders in front, and a suffix of another case or none, if
    it is the only one like it.

    Parameters
    ----------
    images, told : iterable of str
        Names of images, and those in the table.

    Returns
    -------
    dict of str to str
        Names in the table by names of images, of those that have one.

    Raises
    ------
    InvalidArgument
        If a name may be that of several images, or an image has several.
    """
    told, images = set(told), list(images)
    found = {name: name for name in images if name in told}
    left = defaultdict(list)
    for name in sorted(told - found.keys()):
        left[_parts(name)[-1]].append(name)
    users: dict[str, str] = {}
    for image in images:
        if image not in found:
            for name in _alike(image, left):
                _require_single(image, name, found, users)
                found[image], users[name] = name, image
    return found


def _alike(image: str, told: dict[str, list[str]]) -> Iterator[str]:
    *folders, file = _parts(image)
    for called in dict.fromkeys((file, PurePath(file).stem)):
        parts = (*folders, called)
        for name in told.get(called, ()):
            others = _parts(name)
            shared = min(len(parts), len(others))
            if parts[-shared:] == others[-shared:]:
                yield name


def _require_single(image: str, name: str, found: dict[str, str], users: dict[str, str]) -> None:
    if image in found:
        raise InvalidArgument(
            f"gps: the positions of {found[image]} and of {name} may both be those of {image}"
        )
    if name in users:
        raise InvalidArgument(f"gps: the position of {name} may be that of {users[name]} or of {image}")


def _parts(name: str) -> tuple[str, ...]:
    """Folders and file, the suffix in lower case; names may come from Windows."""
    *folders, file = PureWindowsPath(name).parts or (name,)
    path = PurePath(file)
    return (*folders, path.stem + path.suffix.lower())
