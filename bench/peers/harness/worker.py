"""The process in which one in-process peer runs once: ``python -m harness.worker REQUEST.json``."""

from __future__ import annotations

import importlib
import json
import sys
import time
from pathlib import Path
from typing import Any

from harness.bal_file import read_bal
from harness.in_process import InProcessPeer
from harness.process_memory import peak_bytes, reset_peak, resident_bytes
from harness.protocol import Job, StoppingRule


def run(request: dict[str, Any]) -> None:
    """Import, read, prepare, solve, save; memory is measured between these."""
    peer: InProcessPeer = importlib.import_module(request["module"]).PEER
    job = _job(request["job"])
    importlib.import_module(peer.package)
    start = resident_bytes()
    problem = read_bal(job.bal_path)
    inputs = resident_bytes()
    solve = peer.prepare(problem, job, request["settings"])
    reset_peak()  # what building the inputs held and let go, such as the text of a file, is not of the solve
    began = time.perf_counter()
    solution = solve()
    seconds = time.perf_counter() - began
    peer.save(job, solution, seconds, (start, inputs, peak_bytes()))


def _job(values: dict[str, Any]) -> Job:
    paths = {key: Path(values[key]) for key in ("bal_path", "folder")}
    return Job(**{**values, **paths, "rule": StoppingRule(**values["rule"])})


if __name__ == "__main__":
    run(json.loads(Path(sys.argv[1]).read_text()))
