"""Cells that say in a word that there is no value, as pandas, R and loggers write them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

# What pandas reads as missing, in lower case, but for an empty cell.
_WORDS = frozenset(("nan", "-nan", "na", "n/a", "<na>", "#n/a", "#na", "null", "none", "nat"))

Line = tuple[int, list[str]]


def is_missing(cell: str) -> bool:
    """Whether a cell is a word for no value, such as ``NaN`` or ``N/A``; an empty one is none."""
    return cell.lower() in _WORDS


def is_start_of_missing(cell: str) -> bool:
    """Whether a cell begins such a word, and does not end it."""
    return not is_missing(cell) and any(word.startswith(cell.lower()) for word in _WORDS)


def without_missing(
    lines: Sequence[Line], groups: Mapping[str, Sequence[int]]
) -> tuple[list[Line], dict[str, list[int]]]:
    """Empty the cells of each group of columns in which one of them is a word for no value.

    Parameters
    ----------
    lines : sequence of (int, list of str)
        Numbered lines of a file as cells.
    groups : mapping of str to sequence of int
        The places of the columns that belong together, by the name of the group.

    Returns
    -------
    lines : list of (int, list of str)
        The lines; those with such a word are new lists.
    missing : dict of str to list of int
        The numbers of the lines in which a group was emptied, by its name.
    """
    missing: dict[str, list[int]] = {}
    found: list[Line] = []
    for number, cells in lines:
        torn = [
            group for group, places in groups.items() if any(is_missing(cells[place]) for place in places)
        ]
        for group in torn:
            missing.setdefault(group, []).append(number)
        emptied = {place for group in torn for place in groups[group]}
        kept = ["" if place in emptied else cell for place, cell in enumerate(cells)] if emptied else cells
        found.append((number, kept))
    return found, missing
