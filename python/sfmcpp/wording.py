"""What sentences of warnings and reports share: counts, and lists that are cut short."""

from __future__ import annotations

from collections.abc import Sequence


def counted(count: int, one: str, many: str | None = None) -> str:
    """Count some things: "1 camera", "1,200 points", "2 photos are"; `many` is `one` and an s by default."""
    return f"{count:,} {one if count == 1 else many or one + 's'}"


def first_few(names: Sequence[str], most: int) -> str:
    """The first of some names, and whether there are more: "a, b, …"."""
    return ", ".join(names[:most]) + (", …" if len(names) > most else "")
