"""One solve in a process of its own: ``python -m scaling.one_run REQUEST.json``, the record on stdout.

The request names the file, the options of the solve and how much memory the process may have.
"""

from __future__ import annotations

import hashlib
import json
import resource
import sys
import time
from pathlib import Path
from typing import Any

from peers.harness.process_memory import peak_bytes, reset_peak, resident_bytes


def run(request: dict[str, Any]) -> dict[str, Any]:
    """Read, solve; memory is counted from after reading to the peak of the solve."""
    import sfmcpp

    if request.get("memory_bytes"):
        resource.setrlimit(resource.RLIMIT_AS, (request["memory_bytes"], request["memory_bytes"]))
    problem = sfmcpp.read(request["path"])
    inputs = resident_bytes()
    reset_peak()
    began, began_cpu = time.perf_counter(), time.process_time()
    summary = sfmcpp.solve(problem, **request["options"])
    seconds, cpu_seconds = time.perf_counter() - began, time.process_time() - began_cpu
    state = b"".join(array.tobytes() for array in (problem.cameras, problem.intrinsics, problem.points))
    return {
        "observations": problem.num_observations,
        "cameras": problem.num_cameras,
        "points": problem.num_points,
        "solver": summary.linear_solver,
        "reason": summary.linear_solver_reason,
        "termination": summary.termination,
        "threads": summary.threads,
        "seconds": seconds,
        "cpu_seconds": cpu_seconds,
        "seconds_setup": summary.seconds_setup,
        "peak_bytes": peak_bytes() - inputs,
        "inputs_bytes": inputs,
        "final_cost": summary.final_cost,
        "trace": [[step.seconds, step.cost] for step in summary.iterations],
        "cg_iterations": sum(step.linear_solver_iterations for step in summary.iterations),
        "state": hashlib.sha256(state).hexdigest()[:16],
    }


if __name__ == "__main__":
    print(json.dumps(run(json.loads(Path(sys.argv[1]).read_text()))))
