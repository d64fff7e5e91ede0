"""Fixtures shared by all Python tests."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]

# For what hangs, and nothing else: where other programs have the processors, a command of two seconds
# can take two minutes.
TIMEOUT_S = 600.0

# A job started in the background ignores Ctrl-C, and its children too: the tests of interrupts need it.
signal.signal(signal.SIGINT, signal.default_int_handler)

# Several processes run the tests, and threads of BLAS wait for one another by computing: where one
# has lost its core, an SVD of a hundred columns takes nine times its processor time.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """Folder of real data: `$SFMCPP_DATA`, or `shared/data` beside the repository; skips where absent."""
    path = Path(os.environ.get("SFMCPP_DATA", REPOSITORY.parent / "shared" / "data"))
    if not path.is_dir():
        pytest.skip(f"real data not found at {path} (set SFMCPP_DATA)")
    return path
