"""The demonstration: a synthetic scene solved from a noisy start, like any other input."""

from __future__ import annotations

from pathlib import Path

from sfmcpp.cli.exit_codes import ExitCode, say
from sfmcpp.cli.run import Job, solve_file
from sfmcpp.cli.targets import Targets
from sfmcpp.sources.io.api import write
from sfmcpp.sources.io.files import failures_named
from sfmcpp.sources.synthetic import circle_scene, perturb


def run_demo(folder: Path, seed: int) -> ExitCode:
    """Write the thesis' circular scene (§4.4.1) with its noisy start to `folder`, and solve it there.

    Raises
    ------
    DatasetError
        If the folder or a file in it cannot be written.
    """
    with failures_named(folder):
        folder.mkdir(parents=True, exist_ok=True)
    source = folder / "problem.npz"
    targets = Targets(folder / "result.ply", folder / "report.json", folder / "convergence.png")
    targets.check(source)
    start = perturb(
        circle_scene(seed=seed), point_sigma_m=0.5, position_sigma_m=1.0, rotation_sigma_deg=15.0, seed=seed
    )
    write(start, source)
    code = solve_file(Job(source, targets, options={}))
    if code == ExitCode.DONE:
        say(f"The demo is in {folder.resolve()}")
    return code
