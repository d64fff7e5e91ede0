"""Memory of this process and of a bare interpreter, as Linux counts it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path


def resident_bytes() -> int:
    """Resident memory now [bytes]."""
    return _status_bytes("VmRSS")


def peak_bytes() -> int:
    """Highest resident memory since the start or the last :func:`reset_peak` [bytes]."""
    return _status_bytes("VmHWM")


def reset_peak() -> None:
    """Restart the peak at the present resident size, so that it forgets what was before."""
    Path("/proc/self/clear_refs").write_text("5")


def interpreter_bytes(imports: str = "") -> int:
    """Resident memory of a new interpreter, after the import statement given if any [bytes]."""
    code = f"{imports}\nprint(next(s for s in open('/proc/self/status') if s.startswith('VmRSS')))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return int(done.stdout.split()[1]) * 1024


def _status_bytes(key: str) -> int:
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) * 1024 for line in lines if line.startswith(key))
