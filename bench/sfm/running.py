"""One side on one set: a process of its own, with its processor time and its peak memory."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from image_sets import ImageSet

HERE = Path(__file__).resolve().parent
SIDES = {"colmap": "runners.colmap", "sfmcpp": "runners.sfmcpp_reconstruct"}


def run_side(side: str, image_set: ImageSet, folder: Path, threads: int) -> dict[str, Any]:
    """Run a side; it leaves its model in ``folder/model`` and what it says of itself in ``folder/run.json``.

    Returns
    -------
    dict
        What `run.json` says, and ``process``: wall and processor seconds with start and imports, peak memory,
        and the load of the machine before and after. After a failure ``error`` is the end of what it printed.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for left in ("run.json", "model/images.bin", "model/images.txt"):
        (folder / left).unlink(missing_ok=True)
    job = {
        "folder": str(folder.resolve()),
        "images": str(image_set.images.resolve()),
        "names": image_set.names,
        "matrix": image_set.camera(),
        "gps": image_set.gps,
        "threads": threads,
    }
    (folder / "job.json").write_text(json.dumps(job, indent=1))
    process = _run([sys.executable, "-m", SIDES[side], str(folder / "job.json")], folder / "log.txt")
    if process.pop("status") != 0 or not (folder / "run.json").exists():
        return {"error": (folder / "log.txt").read_text(errors="replace")[-500:], "process": process}
    return {**json.loads((folder / "run.json").read_text()), "process": process}


def _run(command: list[str], log: Path) -> dict[str, Any]:
    path = os.pathsep.join([str(HERE), *filter(None, [os.environ.get("PYTHONPATH")])])
    load, began = os.getloadavg()[0], time.perf_counter()
    with log.open("wb") as output:
        child = subprocess.Popen(
            command, stdout=output, stderr=subprocess.STDOUT, env={**os.environ, "PYTHONPATH": path}
        )
        _, status, usage = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
    return {
        "status": child.returncode,
        "seconds": time.perf_counter() - began,
        "cpu_seconds": usage.ru_utime + usage.ru_stime,
        "peak_megabytes": usage.ru_maxrss * (1 if sys.platform == "darwin" else 1024) / 1e6,
        "load": [load, os.getloadavg()[0]],
    }
