"""Steps on problems as reconstructions of photos meet them, by options of the solver.

    python bench/real_starts.py --photos FOLDER … [--options '{"initial_damping": 1e-4}' …]

`sfmcpp.sfm` adjusts a growing model many times: each of these problems of at least six images and 3,000
observations is kept as it was at the start, and solved with every set of options, the default first. Printed
are the mean numbers of steps until the cost is within 1e-2, 1e-3, 1e-4 and 1e-5 of the least that any
reached, interpolated in its logarithm, for the default; and for the others the geometric mean of (steps + 1)
over those of the default, without a loss and with that of the reconstruction.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

import sfmcpp
from sfmcpp.cli.main import main as sfmcpp_main
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sfm import adjustment

LEAST_IMAGES, LEAST_OBSERVATIONS = 6, 3000
SHARES = (1e-2, 1e-3, 1e-4, 1e-5)
RULE: dict[str, Any] = {"max_iterations": 50, "function_tolerance": 1e-8}
Start = tuple[sfmcpp.Problem, dict[str, Any]]


def starts_of(photos: Path) -> list[Start]:
    """Problems that a reconstruction adjusts, each with the loss it takes."""
    found: list[Start] = []
    solve = adjustment.solve  # type: ignore[attr-defined]

    def keep(problem: sfmcpp.Problem, **options: Any) -> sfmcpp.Summary:
        if len(problem.cameras) >= LEAST_IMAGES and problem.num_observations > LEAST_OBSERVATIONS:
            loss = {name: options[name] for name in ("loss", "loss_scale_px")}
            found.append((problem.copy(), loss))
        return solve(problem, **options)

    with tempfile.TemporaryDirectory() as folder, patch.object(adjustment, "solve", keep):
        sfmcpp_main(["reconstruct", str(photos), "-o", f"{folder}/out", "--quiet"])
    return found


def steps_to(share: float, costs: FloatArray, best: float) -> float:
    """Steps until a cost is within a share of the best, interpolated; NaN if it is never."""
    above = np.log(np.maximum(costs / best - 1, 1e-14))
    k = int(np.argmax(above <= np.log(share)))
    if above[k] > np.log(share):
        return np.nan
    return float(k - 1 + (above[k - 1] - np.log(share)) / (above[k - 1] - above[k])) if k else 0.0


def steps(start: sfmcpp.Problem, loss: dict[str, Any], ways: Sequence[dict[str, Any]]) -> FloatArray:
    """Numbers (ways, shares) of steps."""
    runs = [sfmcpp.solve(start.copy(), **RULE, **loss, **way).history()["cost"] for way in ways]
    best = min(float(costs.min()) for costs in runs)
    return np.array([[steps_to(share, costs, best) for share in SHARES] for costs in runs])


def main() -> None:
    """Print a line for each folder, loss and set of options."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--photos", nargs="+", type=Path, required=True)
    before = '{"initial_damping": 1e-4, "acceleration": "none"}'
    parser.add_argument("--options", nargs="+", type=json.loads, default=[json.loads(before)])
    arguments = parser.parse_args()
    ways = [{}, *arguments.options]
    for folder in arguments.photos:
        starts = starts_of(folder)
        for losses in (False, True):
            of_all = np.array([steps(start, loss if losses else {}, ways) for start, loss in starts])
            print(f"{folder}, {len(starts)} starts, {'loss of the reconstruction' if losses else 'no loss'}")
            print("  default", np.nanmean(of_all[:, 0], axis=0).round(2))
            for k, way in enumerate(arguments.options, 1):
                ratios = np.log((of_all[:, k] + 1) / (of_all[:, 0] + 1))
                print(f"  {way}", np.exp(np.nanmean(ratios, axis=0)).round(2), flush=True)


if __name__ == "__main__":
    main()
