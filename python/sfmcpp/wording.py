"""What sentences of warnings and reports share: counts, and lists that are cut short."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import islice


def counted(count: int, one: str, many: str | None = None) -> str:
    """Count some things: "1 camera", "1,200 points", "2 photos are"; `many` is `one` and an s by default."""
    return f"{count:,} {one if count == 1 else many or one + 's'}"


def first_few(names: Iterable[str], most: int) -> str:
    """The first of some names, and whether there are more: "a, b, …"; no others are asked for."""
    few = list(islice(names, most + 1))
    return ", ".join(few[:most]) + (", …" if len(few) > most else "")
