"""Our incremental reconstruction with its defaults: ``python -m runners.sfmcpp_reconstruct JOB.json``."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from stopwatch import Stopwatch

SEED = 0


def run(job: dict[str, Any]) -> dict[str, Any]:
    """Reconstruct the images of `job`; the largest model goes to ``folder/model``. Nothing is cached."""
    import sfmcpp
    from sfmcpp.map.files import write_map
    from sfmcpp.sfm import reconstruct

    watch = Stopwatch()
    camera = "auto" if job["matrix"] is None else np.array(job["matrix"])
    with watch.stage("total"):
        found = reconstruct(
            job["images"],
            camera=camera,
            gps="exif" if job["gps"] else "none",
            threads=job["threads"],
            seed=SEED,
        )
    if found.model is not None:
        write_map(found.model, Path(job["folder"]) / "model")
    return {
        "version": sfmcpp.__version__,
        "models": [int(np.count_nonzero(model.registered)) for model in found.models],
        "reasons": {name: image.reason for name, image in found.images.items() if not image.registered},
        "warnings": found.warnings,
        "seconds": {**found.seconds, "total": watch.seconds["total"]},
        "cpu_seconds": watch.cpu_seconds,
    }


if __name__ == "__main__":
    request = json.loads(Path(sys.argv[1]).read_text())
    outcome = run(request)
    (Path(request["folder"]) / "run.json").write_text(json.dumps(outcome, indent=1))
