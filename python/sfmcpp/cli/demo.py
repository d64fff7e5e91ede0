"""`sfmcpp demo`: a scene that is solved and shown."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import typer

from sfmcpp.cli.console import ExitCode, print_result, with_exit_code
from sfmcpp.cli.run import Job, solve_file
from sfmcpp.cli.targets import Targets
from sfmcpp.geometry.similarity import fit_similarity
from sfmcpp.model import Problem
from sfmcpp.sources.io.api import read, write
from sfmcpp.sources.io.files import failures_named
from sfmcpp.sources.synthetic import circle_scene, perturb


@with_exit_code
def demo(
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FOLDER", help="Output folder.")] = Path(
        "sfmcpp-demo"
    ),
    seed: Annotated[int, typer.Option(min=0, help="Random seed of scene and noise.")] = 0,
) -> ExitCode:
    """Solve and show a synthetic scene.

    30 cameras on a circle around 500 points.
    """
    with failures_named(output):
        output.mkdir(parents=True, exist_ok=True)
    pictures = find_spec("matplotlib") is not None
    source, result = output / "problem.npz", output / "result.npz"
    targets = Targets(result, output / "report.json", output / "convergence.png" if pictures else None)
    targets.check(source)
    truth = circle_scene(seed=seed)  # of the thesis (§4.4.1)
    start = perturb(truth, point_sigma_m=0.5, position_sigma_m=1.0, rotation_sigma_deg=15.0, seed=seed)
    write(start, source)
    code = solve_file(Job(source, targets, options={}))
    if code == ExitCode.DONE:
        solved = _aligned(read(result), truth)
        write(solved, output / "result.ply")
        _show(solved, truth, output, pictures)
        print_result(f"The demo is in {output.resolve()}")
    return code


def _aligned(solved: Problem, truth: Problem) -> Problem:
    """The solved scene aligned to the truth: images do not determine the world frame."""
    placed = fit_similarity(solved.centres, truth.centres)
    solved.cameras[:] = placed.apply_to_poses(solved.cameras)
    solved.points[:] = placed.apply(solved.points)
    return solved


def _show(solved: Problem, truth: Problem, folder: Path, pictures: bool) -> None:
    """Points and cameras beside the true ones: a page in three dimensions, and a picture from above."""
    from sfmcpp.study.pages.scene_page import Scene, save_scene_page

    scene = Scene(
        "cameras on a circle",
        solved.points,
        solved.centres,
        solved.cameras,
        truth=truth.centres,
        truth_name="true cameras",
        unit="m",
    )
    save_scene_page(scene, folder / "view.html")
    print_result(f"written          {folder / 'view.html'}: open it in a browser")
    if not pictures:
        print_result("no pictures; to draw them: pip install 'sfmcpp[plot]'")
        return
    from sfmcpp.study.plotting import save_figure
    from sfmcpp.study.plotting.evaluations import plot_top_view

    centres, points, true = (
        from_above[:, [0, 2, 1]] for from_above in (solved.centres, solved.points, truth.centres)
    )
    save_figure(plot_top_view(centres, centres, points, truth=true, unit="m"), folder / "scene.png")
    print_result(f"written          {folder / 'scene.png'}")
