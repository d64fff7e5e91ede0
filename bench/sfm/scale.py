"""Time and memory of a reconstruction against the number of images, of a rendered drive along a street.

    python bench/sfm/scale.py [--counts 50,100,200,300] [--width 640] [--out DIR] [--threads 2] [--profile]

Prints a table and writes DIR/scale.md and DIR/scale.json. Each count is a process of its own, nothing cached.
Seconds are of all processors together, so that other work of the machine hardly counts; the last row has the
exponents e of time ∼ imagesᵉ, by least squares in logarithms. With --profile the calls that took most time of
mapping the longest drive are in DIR/profile.txt.
"""

from __future__ import annotations

import argparse
import cProfile
import json
import pstats
import resource
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

STAGES = ("features", "pairs", "matching", "geometry", "mapping", "refining")
COLUMNS = ("images", "registered", "points", *STAGES, "total", "wall", "peak MB", "centre error m")
_SHOWN_CALLS = 60


def main() -> None:
    """Render, run each count, print."""
    options = _options()
    if options.job is not None:
        _run_here(json.loads(options.job.read_text()))
        return
    counts = sorted(int(count) for count in options.counts.split(","))
    out: Path = options.out
    out.mkdir(parents=True, exist_ok=True)
    _render(out, counts[-1], options.width)
    rows = []
    for count in counts:
        rows.append(_run(out, count, options.threads, options.profile and count == counts[-1]))
        print(f"{count} images: {rows[-1]['total']:.1f} s", flush=True)
    table = _table(rows)
    (out / "scale.md").write_text(table + "\n")
    (out / "scale.json").write_text(json.dumps(rows, indent=1))
    print(table)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--counts", default="50,100,200,300")
    parser.add_argument("--width", type=int, default=640)
    parser.add_argument("--out", type=Path, default=Path("scale"))
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--profile", action="store_true")
    parser.add_argument("--job", type=Path, help=argparse.SUPPRESS)
    return parser.parse_args()


def _render(out: Path, count: int, width: int) -> None:
    """The longest drive, and for each shorter one a folder of links to its first photos."""
    import sfmcpp
    from sfmcpp.sources.synthetic.photos import render_photos

    done = out / f"truth-{count}-{width}"
    if not done.exists():
        size = (width, width * 3 // 4)
        truth = render_photos("street", out / f"photos-{width}", num_images=count, image_size=size)
        sfmcpp.write(truth, done)


def _run(out: Path, count: int, threads: int, profile: bool) -> dict[str, Any]:
    folder = out / str(count)
    folder.mkdir(exist_ok=True)
    (photos,) = out.glob("photos-*")
    for number in range(count):
        link = folder / f"{number:04d}.jpg"
        link.unlink(missing_ok=True)
        link.symlink_to((photos / link.name).resolve())
    (truth,) = out.glob("truth-*")
    job = {
        "folder": str(folder),
        "truth": str(truth),
        "threads": threads,
        "profile": str(out / "profile.txt") if profile else "",
        "result": str(out / f"{count}.json"),
    }
    (out / "job.json").write_text(json.dumps(job))
    subprocess.run([sys.executable, __file__, "--job", str(out / "job.json")], check=True)
    found: dict[str, Any] = json.loads(Path(job["result"]).read_text())
    return found


class _Stages:
    """Processor seconds and peak memory of each stage, as progress tells when one begins."""

    def __init__(self, profiler: cProfile.Profile | None) -> None:
        self.seconds = dict.fromkeys(STAGES, 0.0)
        self.peak_mb: dict[str, float] = {}
        self._profiler = profiler
        self._stage, self._begin = "", time.process_time()

    def __call__(self, stage: str, done: int, total: int) -> bool:
        if stage != self._stage:
            self.close()
            self._stage = stage
        if stage == "geometry" and done == total:
            # What follows is mapping, though it tells of it only when there is a first model.
            self.close()
            self._stage = "mapping"
            if self._profiler is not None:
                self._profiler.enable()
        return False

    def close(self) -> None:
        """End the stage."""
        now = time.process_time()
        if self._stage:
            self.seconds[self._stage] += now - self._begin
            self.peak_mb[self._stage] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        self._begin = now


def _run_here(job: dict[str, Any]) -> None:
    """One count, in this process."""
    from sfmcpp.sfm import reconstruct
    from sfmcpp.study.evaluation import evaluate_model, read_truth

    profiler = cProfile.Profile() if job["profile"] else None
    stages, begin = _Stages(profiler), time.perf_counter()
    run = reconstruct(job["folder"], matcher="sequential", threads=job["threads"], progress=stages)
    stages.close()
    wall = time.perf_counter() - begin
    if profiler is not None:
        profiler.disable()
        with Path(job["profile"]).open("w") as file:
            pstats.Stats(profiler, stream=file).sort_stats("cumtime").print_stats(_SHOWN_CALLS)
            pstats.Stats(profiler, stream=file).sort_stats("tottime").print_stats(_SHOWN_CALLS)
    row: dict[str, Any] = {"images": len(run.images), "registered": run.num_registered, **stages.seconds}
    row |= {"total": sum(stages.seconds.values()), "wall": wall, "peak_mb": stages.peak_mb}
    row |= {"peak MB": max(stages.peak_mb.values()), "warnings": run.warnings, "pairs": len(run.graph.pairs)}
    if run.model is not None:
        errors = evaluate_model(run.model, read_truth(job["truth"])).to_dict()
        row |= {"points": int(np.count_nonzero(run.model.known))}
        row |= {"centre error m": errors["centre_error"]["mean"], "focal_px": run.model.intrinsics[0, 0]}
    Path(job["result"]).write_text(json.dumps(row, indent=1))


def _table(rows: list[dict[str, Any]]) -> str:
    lines = [COLUMNS, *([_cell(row.get(name)) for name in COLUMNS] for row in rows)]
    if len(rows) > 1:
        lines.append(["exponent", *(_exponent(rows, name) for name in COLUMNS[1:])])
    text = ["| " + " | ".join(line) + " |" for line in lines]
    return "\n".join([text[0], "|" + " --- |" * len(COLUMNS), *text[1:]])


def _cell(value: float | None) -> str:
    if value is None:
        return "–"
    return f"{value:,}" if isinstance(value, int) else f"{value:.3g}" if value < 10 else f"{value:,.1f}"


def _exponent(rows: list[dict[str, Any]], name: str) -> str:
    if name not in (*STAGES, "total", "wall", "peak MB") or any(row[name] <= 0 for row in rows):
        return ""
    images = np.log([row["images"] for row in rows])
    slope = np.polyfit(images, np.log([row[name] for row in rows]), 1)[0]
    return f"{slope:.2f}"


if __name__ == "__main__":
    main()
