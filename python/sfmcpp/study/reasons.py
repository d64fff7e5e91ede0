"""Reasons why something was left out, grouped so that those of a thousand images stay readable."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import TypeVar

T = TypeVar("T")
NAMES_LISTED = 4
_NUMBER = re.compile(r"\b\d[\d.,]*\b")


def by_reason(entries: Iterable[tuple[str, T]]) -> dict[str, list[T]]:
    """Group members by their reason, the largest group first.

    Reasons that differ only in numbers or after a colon form one group, which is named by their common
    text.

    Parameters
    ----------
    entries : iterable of (str, member)
        Reasons, and what was left out for them.
    """
    groups: dict[str, list[tuple[str, T]]] = {}
    for reason, member in entries:
        shared = _NUMBER.sub("…", reason.split(":")[0])
        groups.setdefault(shared, []).append((reason, member))
    named = {}
    for shared, group in sorted(groups.items(), key=lambda item: -len(item[1])):
        named[_name(shared, {reason for reason, _ in group})] = [member for _, member in group]
    return named


def _name(shared: str, reasons: set[str]) -> str:
    """What reasons have in common: all of it, all but the numbers, or what is in front of the colon."""
    for told in (reasons, {_NUMBER.sub("…", reason) for reason in reasons}):
        if len(told) == 1:
            return told.pop()
    return shared


def listed(names: Sequence[str]) -> str:
    """Some names, and how many more there are."""
    shown = ", ".join(names[:NAMES_LISTED])
    more = len(names) - NAMES_LISTED
    return f"{shown} and {more:,} more" if more > 0 else shown
