"""Entry point: arguments in, exit code out. It imports nothing that takes time, to heed Ctrl-C at once."""

from __future__ import annotations

import sys
from collections.abc import Sequence


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    arguments : sequence of str, optional
        What follows the program's name. Default: ``sys.argv[1:]``.

    Returns
    -------
    int
        0 done, 2 bad usage or bad input, 3 no result of input that was read, 130 interrupted by Ctrl-C,
        SIGTERM or SIGHUP.
    """
    try:
        from sfmcpp.cli.dispatch import dispatch

        return dispatch(list(sys.argv[1:] if arguments is None else arguments))
    except KeyboardInterrupt:  # before or after signals are handled
        if sys.stderr is not None:
            print("sfmcpp: interrupted", file=sys.stderr)
        return 130
