"""What is shown while a command runs: a terminal that has gone, or a full disk behind it, ends no work."""

from __future__ import annotations

import os
import sys
from typing import IO, TYPE_CHECKING, Any, cast

if TYPE_CHECKING:
    from rich.console import Console


def stderr_console() -> Console:
    """Make the console that progress is shown on."""
    from rich.console import Console

    return Console(file=cast(IO[str], _Forgiving(sys.stderr)))


def give_up(stream: IO[str]) -> None:
    """Send all that follows nowhere: what is still buffered would fail again when the interpreter ends."""
    try:
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
    except (OSError, ValueError):  # a stream without a file
        return


class _Forgiving:
    """A stream that loses what it cannot write."""

    def __init__(self, stream: IO[str]) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        try:
            return self._stream.write(text)
        except OSError:
            give_up(self._stream)
            return len(text)

    def flush(self) -> None:
        try:
            self._stream.flush()
        except OSError:
            give_up(self._stream)
