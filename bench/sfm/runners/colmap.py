"""COLMAP's incremental reconstruction through pycolmap: ``python -m runners.colmap JOB.json``.

COLMAP's defaults but for the number of threads, the seed and, where K is given, a PINHOLE camera that all
images share and nothing refines. Its default camera, SIMPLE_RADIAL, starts from EXIF where that tells a
focal length, else from 1.2 times the longer side, and is shared where EXIF and size agree.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from stopwatch import Stopwatch

SEED = 0


def run(job: dict[str, Any]) -> dict[str, Any]:
    """Reconstruct the images of `job`; the largest model goes to ``folder/model``."""
    import pycolmap

    pycolmap.set_random_seed(SEED)
    pycolmap.logging.minloglevel = pycolmap.logging.WARNING.value
    folder, watch = Path(job["folder"]), Stopwatch()
    database = folder / "database.db"
    database.unlink(missing_ok=True)
    with watch.stage("features"):
        _extract(database, job)
    with watch.stage("matching"):
        options = pycolmap.FeatureMatchingOptions(num_threads=job["threads"])
        pycolmap.match_exhaustive(database, options, device=pycolmap.Device.cpu)
    with watch.stage("mapping"):
        options = _mapping_options(job["threads"], refine=job["matrix"] is None)
        found = pycolmap.incremental_mapping(database, job["images"], folder, options)
    models = sorted(found.values(), key=lambda model: -model.num_reg_images())
    if models:
        (folder / "model").mkdir(exist_ok=True)
        models[0].write_binary(folder / "model")
    return {
        "version": pycolmap.__version__,
        "models": [model.num_reg_images() for model in models],
        "own_reprojection_px": models[0].compute_mean_reprojection_error() if models else None,
        **watch.to_dict(),
    }


def _extract(database: Path, job: dict[str, Any]) -> None:
    import pycolmap

    mode, reader = pycolmap.CameraMode.AUTO, pycolmap.ImageReaderOptions()
    if job["matrix"] is not None:
        (fx, _, cx), (_, fy, cy), _ = job["matrix"]
        mode, reader.camera_model = pycolmap.CameraMode.SINGLE, "PINHOLE"
        reader.camera_params = ",".join(map(repr, (fx, fy, cx, cy)))
    pycolmap.extract_features(
        database,
        job["images"],
        job["names"],
        mode,
        reader,
        pycolmap.FeatureExtractionOptions(num_threads=job["threads"]),
        pycolmap.Device.cpu,
    )


def _mapping_options(threads: int, refine: bool) -> Any:
    import pycolmap

    options = pycolmap.IncrementalPipelineOptions(num_threads=threads, random_seed=SEED)
    options.mapper.num_threads = threads
    options.ba_refine_focal_length = options.ba_refine_extra_params = refine
    options.mapper.abs_pose_refine_focal_length = options.mapper.abs_pose_refine_extra_params = refine
    return options


if __name__ == "__main__":
    request = json.loads(Path(sys.argv[1]).read_text())
    outcome = run(request)
    (Path(request["folder"]) / "run.json").write_text(json.dumps(outcome, indent=1))
