"""Names in the order in which people count: image2 before image10."""

from __future__ import annotations

import re


def words_and_numbers(name: str) -> list[tuple[int, str]]:
    """Parts of a name: (number, "") where it has digits, (-1, text) elsewhere."""
    parts = re.findall(r"[0-9]+|[^0-9]+", name)
    return [(int(part), "") if part[0].isdecimal() else (-1, part) for part in parts]


def natural_order(name: str) -> tuple[list[tuple[int, str]], str]:
    """Key by which image2 comes before image10; different names have different keys."""
    return words_and_numbers(name), name
