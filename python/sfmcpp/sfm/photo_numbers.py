"""Numbers at the end of names of photos, by which the tables of drones name them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import PurePath

from sfmcpp.errors import InvalidArgument

# DJI_0012, DJI_20260803132556_0012, with the camera or band behind …_0012_V, …_0012_MS_NIR. A date is longer.
_NUMBER = re.compile(r"(?:.*\D)?(\d{3,6})((?:_[A-Za-z]+)*)")


def match_photo_numbers(images: Sequence[str], numbers: Iterable[str]) -> dict[str, str]:
    """Find for each image the number of a table that its name ends in.

    Parameters
    ----------
    images : sequence of str
        Names of images.
    numbers : iterable of str
        Numbers in the table, without leading zeros.

    Returns
    -------
    dict of str to str
        Numbers by names of images, of those that have one.

    Raises
    ------
    InvalidArgument
        If no image has any of them, or two of one camera have the same.
    """
    table = set(numbers)
    found: dict[str, str] = {}
    users: dict[tuple[str, str], str] = {}
    for image in images:
        ending = _NUMBER.fullmatch(PurePath(image).stem)
        number = "" if ending is None else str(int(ending[1]))
        if ending is None or number not in table:
            continue
        other = users.setdefault((number, ending[2].upper()), image)
        if other != image:
            raise InvalidArgument(
                f"gps: photo {number} may be {other} or {image}: a table of photo numbers is that of one "
                "flight; give photos of several a table with names"
            )
        found[image] = number
    if not found:
        inside = sorted(map(int, table))
        raise InvalidArgument(
            f"gps: its photo numbers, {inside[0]} to {inside[-1]}, are not those that the names of images "
            f"({', '.join(images[:3])}) end in, as DJI_0012.JPG does; rename them, or give a table with names"
        )
    return found
