"""Fixtures shared by all Python tests."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]

# A job started in the background ignores Ctrl-C, and its children too: the tests of interrupts need it.
signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """Folder of real data: `$SFMCPP_DATA`, or `shared/data` beside the repository; skips where absent."""
    path = Path(os.environ.get("SFMCPP_DATA", REPOSITORY.parent / "shared" / "data"))
    if not path.is_dir():
        pytest.skip(f"real data not found at {path} (set SFMCPP_DATA)")
    return path
