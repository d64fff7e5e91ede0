"""`sfmcpp solve` on good input: results, report and silence."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

import sfmcpp
from cli_helpers import noisy_circle, run, run_here, strict_json, write_noisy_circle

REPORT_FIELDS: dict[str, type | tuple[type, ...]] = {
    "input": dict,
    "initial_cost": float,
    "final_cost": float,
    "initial_rms_px": float,
    "final_rms_px": float,
    "termination": str,
    "message": str,
    "method": str,
    "line_search": str,
    "linear_solver": str,
    "linear_solver_reason": str,
    "loss": str,
    "threads": int,
    "seconds_total": float,
    "seconds_read": float,
    "peak_memory_bytes": int,
    "warnings": list,
    "observations_behind_camera": list,
    "iterations": list,
}
ITERATION_FIELDS: dict[str, type] = {
    "iteration": int,
    "cost": float,
    "seconds": float,
    "accepted": bool,
    "damping": float,
    "gradient_norm": float,
    "step_norm": float,
    "step_lengths": list,
    "linear_solver_iterations": int,
    "proposed_lengths": list,
    "line_searched": bool,
    "held_points": int,
    "cost_evaluations": int,
}


def wrong_types(record: dict[str, Any], fields: dict[str, Any]) -> list[str]:
    """Fields that are missing or of another type; a bool is no int here."""
    return [
        f"{name}: {record.get(name)!r}"
        for name, kind in fields.items()
        if not isinstance(record.get(name), kind) or (kind is int and isinstance(record[name], bool))
    ]


@pytest.mark.real
def test_a_real_problem_is_solved_and_its_file_holds_the_solution(data_dir: Path, tmp_path: Path) -> None:
    output, report = tmp_path / "out.txt.bz2", tmp_path / "report.json"
    source = data_dir / "bal/problem-49-7776-pre.txt.bz2"
    result = run("solve", source, "-o", output, "--report", report, "--plot", tmp_path / "out.png")
    assert (result.returncode, result.stderr) == (0, "")
    content = strict_json(report)
    assert 1.3344e4 < content["final_cost"] <= 1.3358e4
    assert content["initial_cost"] == pytest.approx(8.509125e5, rel=1e-6)
    assert content["observations_behind_camera"][0] == 31
    assert sfmcpp.cost(sfmcpp.read(output)) == pytest.approx(content["final_cost"], rel=1e-9)


def test_the_report_has_every_field_of_the_contract_in_its_type(tmp_path: Path) -> None:
    source, report = write_noisy_circle(tmp_path), tmp_path / "report.json"
    assert run_here("solve", source, "--report", report).returncode == 0
    content = strict_json(report)
    assert wrong_types(content, REPORT_FIELDS) == []
    assert [wrong_types(iteration, ITERATION_FIELDS) for iteration in content["iterations"]] == [
        [] for _ in content["iterations"]
    ]
    problem = sfmcpp.read(source)
    assert content["input"] == {
        "path": str(source),
        "cameras": problem.num_cameras,
        "points": problem.num_points,
        "observations": problem.num_observations,
    }


def test_the_history_runs_from_the_initial_to_the_final_cost_and_never_up(tmp_path: Path) -> None:
    source, report = write_noisy_circle(tmp_path), tmp_path / "report.json"
    run("solve", source, "--report", report)
    content = strict_json(report)
    costs = [iteration["cost"] for iteration in content["iterations"]]
    seconds = [iteration["seconds"] for iteration in content["iterations"]]
    assert (costs[0], costs[-1]) == (content["initial_cost"], content["final_cost"])
    assert costs[0] == pytest.approx(sfmcpp.cost(sfmcpp.read(source)), rel=1e-12)
    assert costs == sorted(costs, reverse=True)
    assert seconds == sorted(seconds)
    assert 0 < seconds[-1] <= content["seconds_total"]
    assert [i["iteration"] for i in content["iterations"]] == list(range(len(costs)))
    # An interpreter with NumPy needs more than 10 MB; this problem must not need 1 GB.
    assert 10e6 < content["peak_memory_bytes"] < 1e9


def test_options_reach_the_solver(tmp_path: Path) -> None:
    source, output, report = write_noisy_circle(tmp_path), tmp_path / "out.npz", tmp_path / "report.json"
    options = {
        "method": "lm",
        "linear_solver": "iterative",
        "loss": "huber",
        "loss_scale_px": 0.5,
        "max_iterations": 3,
        "function_tolerance": 1e-12,
        "threads": 1,
        "gauge": "fixed",
    }
    arguments = [f"--{name.replace('_', '-')}={value}" for name, value in options.items()]
    assert run_here("solve", source, "-o", output, "--report", report, *arguments).returncode == 0
    expected = sfmcpp.read(source)
    summary = sfmcpp.solve(expected, **options)  # type: ignore[arg-type]
    content = strict_json(report)
    assert content["final_cost"] == summary.final_cost
    assert content["termination"] == "max_iterations"
    used = {name: content[name] for name in ("method", "linear_solver", "loss", "loss_scale_px", "threads")}
    assert used == {name: options[name] for name in used}
    solved = sfmcpp.read(output)
    assert (solved.cameras == expected.cameras).all()
    assert (solved.points == expected.points).all()


def test_an_automatic_loss_scale_comes_from_the_data(tmp_path: Path) -> None:
    source, report = write_noisy_circle(tmp_path), tmp_path / "report.json"
    run_here("solve", source, "--report", report, "--loss", "cauchy", "--loss-scale-px", "auto")
    expected = sfmcpp.solve(sfmcpp.read(source), loss="cauchy", loss_scale_px="auto")
    assert strict_json(report)["loss_scale_px"] == expected.loss_scale_px != 1.0


def test_refine_frees_exactly_the_named_intrinsics(tmp_path: Path) -> None:
    source, output = write_noisy_circle(tmp_path, camera_model="bal"), tmp_path / "out.npz"
    assert run_here("solve", source, "-o", output, "--refine", "f,k1").returncode == 0
    changed = (sfmcpp.read(output).intrinsics != sfmcpp.read(source).intrinsics).any(axis=0)
    assert changed.tolist() == [True, True, False]
    assert run_here("solve", source, "-o", output, "--refine", "none").returncode == 0
    assert (sfmcpp.read(output).intrinsics == sfmcpp.read(source).intrinsics).all()


def test_a_time_limit_ends_the_solve_with_the_best_state_and_success(tmp_path: Path) -> None:
    source, output, report = write_noisy_circle(tmp_path), tmp_path / "out.npz", tmp_path / "report.json"
    result = run_here("solve", source, "-o", output, "--report", report, "--max-seconds", "1e-9")
    content = strict_json(report)
    assert (result.returncode, content["termination"]) == (0, "max_seconds")
    assert len(content["iterations"]) <= 2
    assert sfmcpp.cost(sfmcpp.read(output)) == pytest.approx(content["final_cost"], rel=1e-12)


def test_quiet_says_nothing_and_writes_the_same(tmp_path: Path) -> None:
    source, loud, silent = write_noisy_circle(tmp_path), tmp_path / "loud.npz", tmp_path / "silent.npz"
    assert run("solve", source, "-o", loud).stdout != ""
    result = run("solve", source, "-o", silent, "--quiet")
    assert (result.returncode, result.stdout, result.stderr) == (0, "", "")
    assert silent.read_bytes() == loud.read_bytes()


def test_the_table_tells_sizes_costs_termination_solver_and_files(tmp_path: Path) -> None:
    source, output, report = write_noisy_circle(tmp_path), tmp_path / "o[ut].npz", tmp_path / "report.json"
    result = run_here("solve", source, "-o", output, "--report", report)
    content = strict_json(report)
    assert result.stderr == ""
    for expected in (
        str(source),
        f"{6} cameras, {60} points, {noisy_circle().num_observations:,} observations",
        f"{content['initial_cost']:.6e} → {content['final_cost']:.6e}",
        f"{content['initial_rms_px']:.6g} → {content['final_rms_px']:.6g}",
        f"converged: {content['message']}",
        content["linear_solver"],
        str(output),
        str(report),
    ):
        assert expected in result.stdout.replace("\n", "")
    assert "not kept" not in result.stdout


def test_a_result_that_no_file_keeps_is_said_to_be_lost(tmp_path: Path) -> None:
    result = run_here("solve", write_noisy_circle(tmp_path))
    assert (result.returncode, result.stderr) == (0, "")
    assert result.stdout.splitlines()[-1].split(maxsplit=1) == [
        "result",
        "not saved; use -o FILE to write it",
    ]


def test_warnings_are_listed_by_name(tmp_path: Path) -> None:
    problem = noisy_circle()
    problem.points = problem.points.copy()
    seen_once = (problem.point_index != 7) | (problem.camera_index == 0)
    for name in ("camera_index", "point_index", "pixels"):
        setattr(problem, name, getattr(problem, name)[seen_once])
    source = tmp_path / "once.npz"
    sfmcpp.write(problem, source)
    result = run_here("solve", source)
    assert result.returncode == 0
    assert "point 7" in result.stdout


def test_the_result_may_replace_the_input(tmp_path: Path) -> None:
    source = write_noisy_circle(tmp_path)
    before = sfmcpp.cost(sfmcpp.read(source))
    assert run_here("solve", source, "-o", source).returncode == 0
    assert sfmcpp.cost(sfmcpp.read(source)) < before / 100
    assert list(tmp_path.iterdir()) == [source]


def test_a_report_may_lie_in_the_folder_that_a_model_makes(tmp_path: Path) -> None:
    path, model = write_noisy_circle(tmp_path), tmp_path / "model"
    done = run("solve", str(path), "-o", str(model), "--report", str(model / "report.json"))
    assert done.returncode == 0, done.stderr
    assert sfmcpp.read(model).num_observations
    assert strict_json(model / "report.json")["final_cost"] > 0


def test_line_searches_and_methods_reach_the_report(tmp_path: Path) -> None:
    source = write_noisy_circle(tmp_path)
    options = ["--method", "dog-leg", "--line-search", "t-als", "--line-search-iterations", "2"]
    assert run_here("solve", source, *options, "--report", tmp_path / "r.json").returncode == 0
    report = strict_json(tmp_path / "r.json")
    assert (report["method"], report["line_search"]) == ("dog-leg", "t-als")
    searched = [iteration["line_searched"] for iteration in report["iterations"][1:]]
    assert searched == [k < 2 for k in range(len(searched))]
    assert all(len(pair) == 2 for pair in report["iterations"][1]["proposed_lengths"])


def test_a_projective_solve_forgets_the_calibration(tmp_path: Path) -> None:
    source, target = write_noisy_circle(tmp_path), tmp_path / "out.npz"
    assert run_here("solve", source, "--camera-model", "projective", "-o", target).returncode == 0
    solved = sfmcpp.read(target)
    assert solved.camera_model == "projective"
    calibrated = sfmcpp.read(source)
    sfmcpp.solve(calibrated)
    assert sfmcpp.cost(solved) < sfmcpp.cost(calibrated)


def test_a_projective_solve_is_refused_a_format_that_cannot_hold_it(tmp_path: Path) -> None:
    source, target = write_noisy_circle(tmp_path), tmp_path / "out.txt"
    result = run_here("solve", source, "--camera-model", "projective", "-o", target)
    assert result.returncode == 2
    assert "metric cameras only" in result.stderr
    assert not target.exists()


def test_a_camera_model_that_refining_has_made_larger_is_told(tmp_path: Path) -> None:
    scene = noisy_circle(camera_model="perspective").set_free_intrinsics("f", "k1")
    sfmcpp.write(scene, tmp_path / "model")
    result = run_here("solve", "model", "-o", "same", cwd=tmp_path)
    assert (result.returncode, result.stderr) == (0, "")
    result = run_here("solve", "model", "-o", "refined", "--refine", "f,p1", cwd=tmp_path)
    assert result.returncode == 0
    assert "refined: cameras of model SIMPLE_RADIAL have become OPENCV" in result.stderr
    assert run_here("solve", "model", "-o", "q", "--refine", "f,p1", "--quiet", cwd=tmp_path).stderr == ""


def test_names_of_other_programs_are_told_as_ours(tmp_path: Path) -> None:
    source = write_noisy_circle(tmp_path, camera_model="perspective")
    for other, ours in (("k", "k1"), ("fy", "aspect")):
        result = run_here("solve", source, "--refine", f"f,{other}")
        assert result.returncode == 2
        assert f"{other} of other programs is {ours}" in result.stderr


@pytest.mark.parametrize("solver", ["auto", "dense"])
def test_the_forecast_of_a_step_is_told_once(tmp_path: Path, solver: str) -> None:
    start = write_noisy_circle(tmp_path)
    told = run_here("solve", start, "-o", tmp_path / "b.npz", "--linear-solver", solver).stdout
    (line,) = (line for line in told.splitlines() if "dense" in line and " MB" in line)
    assert line.startswith("linear solver")
    assert line.count("predicted for a step") == 1


def test_each_forecast_has_a_name_of_its_own(tmp_path: Path) -> None:
    source = tmp_path / "city.npz"
    sfmcpp.write(sfmcpp.city_blocks_scene(300, seed=0), source)
    told = run_here("solve", source, "--max-iterations", "1").stdout
    text = " ".join(told.split("linear solver", 1)[1].split("seconds", 1)[0].split())
    names = re.findall(r"(?:: |, )([a-z][^,:]*?) [\d.e+]+ m?s and", text)
    assert len(names) == len(set(names)) > 2
    assert "iterative with S in blocks" in names
