"""The note's two variants, W stored and W never stored: time and memory of both, on any problem.

    python bench/stored_w.py PROGRAM FILE [FILE2 …] [--repeats 5] [--out stored-w.json]

PROGRAM is `sfmcpp_stored_w` of a release build with benchmarks: both variants written in the same way, with
the same storage of S, the same order of sums and the same flags, on one thread. The Jacobian is that of
sfmcpp at the problem's state. Each run is a process of its own; both must find the same S and the same step
of the points. Milliseconds are the least of the repeats; bytes are what a variant has to keep from the
linearisation to the step of the points: W, or J and the whitened point Jacobians.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

VARIANTS = ("stored", "never")
AGREEMENT = 1e-9


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure on every file; print the table, write JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("program", type=Path)
    parser.add_argument("files", nargs="+", type=Path)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--out", type=Path, default=Path("stored-w.json"))
    args = parser.parse_args(arguments)
    rows = [row for path in args.files for row in measure(args.program, path, args.repeats)]
    args.out.write_text(json.dumps(rows, indent=1))
    args.out.with_suffix(".md").write_text(markdown(rows) + "\n")
    print(markdown(rows))


def measure(program: Path, path: Path, repeats: int) -> list[dict[str, Any]]:
    """A row for each variant."""
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder, "jacobian.bin")
        observations = write_jacobian(path, target)
        rows = []
        for variant in VARIANTS:
            command = [str(program), str(target), variant, str(repeats)]
            done = subprocess.run(command, capture_output=True, text=True, check=True)
            found = json.loads(done.stdout)
            rows.append({"file": path.stem, "observations": observations, "W": variant, **found})
    stored, never = rows
    for norm in ("norm_of_s", "norm_of_step"):
        if abs(stored[norm] / never[norm] - 1) > AGREEMENT:
            raise SystemExit(f"{path}: {norm} differs: {stored[norm]} and {never[norm]}")
    return rows


def write_jacobian(path: Path, target: Path) -> int:
    """What the program reads: counts, indices, Jacobians and residuals by camera and then by point."""
    import sfmcpp

    problem = sfmcpp.read(path)
    of_camera, of_point = sfmcpp.linearize(problem).blocks()
    residuals = np.asarray(sfmcpp.residuals(problem))
    if of_camera.shape[2] != 9:
        raise SystemExit(f"{path}: its cameras have {of_camera.shape[2]} free parameters, must be 9 (BAL)")
    order = np.lexsort((problem.point_index, problem.camera_index))
    counts = np.array([problem.num_cameras, problem.num_points, problem.num_observations], dtype=np.int64)
    with target.open("wb") as file:
        counts.tofile(file)
        problem.camera_index[order].tofile(file)
        problem.point_index[order].tofile(file)
        # Eigen stores by columns.
        np.ascontiguousarray(of_camera[order].transpose(0, 2, 1)).tofile(file)
        np.ascontiguousarray(of_point[order].transpose(0, 2, 1)).tofile(file)
        residuals[order].tofile(file)
    return problem.num_observations


def markdown(rows: Sequence[dict[str, Any]]) -> str:
    """The table, and ratios."""
    lines = [
        "| file | observations | W | ms: W or G | S | points | in all | bytes an observation | MB |",
        "|---|--:|---|--:|--:|--:|--:|--:|--:|",
    ]
    for row in rows:
        parts = [row["prepare_ms"], row["schur_ms"], row["back_ms"]]
        shown = " | ".join(f"{ms:.1f}" for ms in (*parts, sum(parts)))
        each = row["bytes"] / row["observations"]
        lines.append(
            f"| {row['file']} | {row['observations']:,} | {row['W']} | {shown} | {each:.0f} "
            f"| {row['bytes'] / 1e6:.1f} |"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    main()
