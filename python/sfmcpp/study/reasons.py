"""Reasons why something was left out, grouped so that a person can read those of a thousand images."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import TypeVar

T = TypeVar("T")
_NUMBER = re.compile(r"\b\d[\d.,]*\b")


def by_reason(entries: Iterable[tuple[str, T]]) -> dict[str, list[T]]:
    """Group what has a reason by it, the largest group first.

    Reasons are the same if they differ in numbers, or behind a colon, alone; a group of such is named by what
    they share.
    """
    groups: dict[str, list[tuple[str, T]]] = {}
    for reason, member in entries:
        shared = _NUMBER.sub("…", reason.split(":")[0])
        groups.setdefault(shared, []).append((reason, member))
    named = {}
    for shared, group in sorted(groups.items(), key=lambda item: -len(item[1])):
        same = len({reason for reason, _ in group}) == 1
        named[group[0][0] if same else shared] = [member for _, member in group]
    return named
