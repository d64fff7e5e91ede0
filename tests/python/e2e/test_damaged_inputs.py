"""Every reader on files damaged at random: a short run of `make fuzz`."""

from __future__ import annotations

import subprocess
import sys

import pytest
from conftest import REPOSITORY

from cli_helpers import TIMEOUT_S

pytest.importorskip("PIL", reason="Pillow is not installed: pip install 'sfmcpp[vision]'")
pytest.importorskip("yaml", reason="PyYAML is not installed: pip install 'sfmcpp[vision]'")


def test_damaged_files_are_read_or_refused_by_name() -> None:
    command = [sys.executable, REPOSITORY / "tools" / "mutate_inputs.py", "--inputs", "3000", "--seed", "1"]
    told = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT_S, check=False)
    assert told.returncode == 0, told.stdout + told.stderr
