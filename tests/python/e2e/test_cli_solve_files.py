"""`sfmcpp solve --view` and `--covariances`, `sfmcpp convert OUT.html`: what else a solve can write."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sfmcpp
from cli_helpers import is_one_error_line, run_here, strict_json, write_noisy_circle
from sfmcpp.errors import DatasetError
from sfmcpp.model import Metadata
from sfmcpp.model.metadata import WorldOrigin
from sfmcpp.study import covariance_files
from sfmcpp.study.pages.model_page import write_problem_page


def rows_of(path: Path) -> list[dict[str, Any]]:
    with path.open() as file:
        return list(csv.DictReader(file))


def test_standard_deviations_are_those_of_the_linear_model_at_the_result(tmp_path: Path) -> None:
    source, output, table = write_noisy_circle(tmp_path), tmp_path / "out.npz", tmp_path / "sigmas.csv"
    report = tmp_path / "report.json"
    result = run_here(
        "solve", source, "-o", output, "--covariances", table, "--report", report, "--loss", "huber"
    )
    assert (result.returncode, result.stderr) == (0, "")
    told, solved = strict_json(report), sfmcpp.read(output)
    assert told["covariances"]["free_freedoms"] == 7
    model = sfmcpp.linearize(solved, loss="huber", loss_scale_px=told["loss_scale_px"])
    found = model.covariance(cameras="all", points="all")
    rows = rows_of(table)
    assert [row["kind"] for row in rows] == ["camera"] * 6 + ["point"] * 60
    of_camera, of_point = np.sqrt(np.diag(found.cameras[2])), np.sqrt(np.diag(found.points[5]))
    written = [float(rows[2][f"sigma_{name}"]) for name in ("rx_deg", "ry_deg", "rz_deg", "x", "y", "z")]
    np.testing.assert_allclose(written, of_camera[:6] * ([180 / np.pi] * 3 + [1] * 3), rtol=1e-5)
    np.testing.assert_allclose([float(rows[11][f"sigma_{n}"]) for n in "xyz"], of_point, rtol=1e-5)
    assert rows[11]["sigma_rx_deg"] == ""
    assert told["covariances"]["variance_factor"] == pytest.approx(model.variance_factor)
    assert "7 gauge freedoms are left" in " ".join(result.stdout.split())


def test_covariances_as_arrays_are_not_numbers_where_nothing_was_estimated(tmp_path: Path) -> None:
    problem = sfmcpp.read(write_noisy_circle(tmp_path))
    problem.fixed_cameras[:2] = True
    sfmcpp.write(problem, tmp_path / "start.npz")
    arrays = tmp_path / "covariances.npz"
    result = run_here("solve", tmp_path / "start.npz", "--covariances", arrays)
    assert result.returncode == 0
    assert "the frame that fixed parameters or positions give" in " ".join(result.stdout.split())
    with np.load(arrays) as found:
        assert found["free_freedoms"] == 0
        assert found["cameras"].shape == (6, 6, 6)
        assert found["parameter_names"][3] == "centre x"
        assert np.isnan(found["cameras"][:2]).all()
        assert np.linalg.eigvalsh(found["cameras"][2:]).min() > 0
        assert np.linalg.eigvalsh(found["points"]).min() > 0


@pytest.mark.parametrize(
    ("option", "name", "told"),
    [
        ("--covariances", "sigmas.txt", "the name of a file of covariances must end in .csv, .npz"),
        ("--view", "view.png", "the name of a page must end in .html, .htm"),
    ],
)
def test_names_that_tell_no_format_are_refused_before_the_solve(
    tmp_path: Path, option: str, name: str, told: str
) -> None:
    result = run_here("solve", write_noisy_circle(tmp_path), option, tmp_path / name)
    assert result.returncode == 2
    assert is_one_error_line(result)
    assert told in result.stderr


def test_a_dash_is_no_folder_of_a_model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = write_noisy_circle(tmp_path)
    monkeypatch.chdir(tmp_path)
    result = run_here("solve", source, "-o", "-")
    assert result.returncode == 2
    assert is_one_error_line(result)
    assert "-: nothing is written to the standard output" in result.stderr
    assert not (tmp_path / "-").exists()


@pytest.mark.parametrize(("option", "name"), [("--covariances", "sigmas.csv"), ("--view", "view.html")])
def test_projective_worlds_have_neither_page_nor_covariances(tmp_path: Path, option: str, name: str) -> None:
    source = write_noisy_circle(tmp_path)
    result = run_here("solve", source, "--camera-model", "projective", option, tmp_path / name)
    assert result.returncode == 2
    assert "projective cameras have no" in result.stderr
    assert not (tmp_path / name).exists()


def test_an_undetermined_point_leaves_the_result_and_a_word(tmp_path: Path) -> None:
    problem = sfmcpp.read(write_noisy_circle(tmp_path))
    seen_once = problem.point_index != 7
    seen_once[np.flatnonzero(~seen_once)[0]] = True
    sfmcpp.write(problem.with_observations(seen_once), tmp_path / "start.npz")
    output, table = tmp_path / "out.npz", tmp_path / "sigmas.csv"
    result = run_here("solve", tmp_path / "start.npz", "-o", output, "--covariances", table)
    assert result.returncode == 2
    assert "no covariances: point 7" in result.stderr
    assert output.exists()
    assert not table.exists()


def test_covariances_away_from_a_minimum_are_doubted_or_left_out_and_the_report_says_so(
    tmp_path: Path,
) -> None:
    source, table, report = write_noisy_circle(tmp_path), tmp_path / "sigmas.csv", tmp_path / "report.json"
    files = ("--covariances", table, "--report", report)
    assert "are right at a minimum alone" not in run_here("solve", source, *files).stdout
    told = strict_json(report)["covariances"]
    assert (told["written"], set(told) & {"reason", "doubt"}) == (True, set())
    result = run_here("solve", source, *files, "--method", "gradient-descent", "--max-iterations", "1")
    doubt = "are right at a minimum alone, and the solve ended by max_iterations"
    assert (result.returncode, doubt in result.stdout) == (0, True)
    assert (strict_json(report)["covariances"]["doubt"], table.exists()) == (doubt, True)
    table.unlink()
    problem = sfmcpp.read(source)
    problem.pixels[5] = 1e150
    sfmcpp.write(problem, source)
    result = run_here("solve", source, *files, "--quiet")
    assert (result.returncode, table.exists()) == (3, False)
    assert result.stderr.endswith("; the covariances are not written\n")
    reason = "not written: the solve ended by numerical_failure, at no minimum"
    assert strict_json(report)["covariances"] == {"written": False, "reason": reason}


def test_a_page_shows_the_result_and_convert_makes_the_same(tmp_path: Path) -> None:
    source, output = write_noisy_circle(tmp_path), tmp_path / "out.npz"
    result = run_here("solve", source, "-o", output, "--view", tmp_path / "view.html")
    assert (result.returncode, result.stderr) == (0, "")
    result = run_here("convert", output, tmp_path / "again.html")
    assert (result.returncode, result.stderr) == (0, "")
    solved, again = ((tmp_path / name).read_text() for name in ("view.html", "again.html"))
    assert solved.replace("start.npz", "out.npz") == again


def test_a_page_has_metres_and_north_where_latitudes_have_told_the_world(tmp_path: Path) -> None:
    problem = sfmcpp.circle_scene(6, 50, seed=0)
    page = tmp_path / "view.html"
    for origin, unit, north in (
        (None, '""', "null"),
        (WorldOrigin(np.array([5e5, 5e6, 0.0]), geodetic=False), '"m"', "null"),
        (WorldOrigin(np.array([48.0, 11.0, 500.0]), geodetic=True), '"m"', "[0.0, 1.0, 0.0]"),
    ):
        problem.metadata = Metadata()
        if origin is not None:
            origin.put_into(problem.metadata)
        write_problem_page(problem, page, "a circle")
        text = page.read_text()
        assert f'"unit": {unit}' in text
        assert f'"north": {north}' in text


def test_a_page_of_projective_cameras_is_refused(tmp_path: Path) -> None:
    problem = sfmcpp.as_projective(sfmcpp.circle_scene(6, 50, seed=0))
    with pytest.raises(DatasetError, match="projective cameras have no world to show"):
        write_problem_page(problem, tmp_path / "view.html", "a circle")


def test_covariances_with_positions_are_those_that_the_accuracy_is_told_by(tmp_path: Path) -> None:
    truth = sfmcpp.circle_scene(12, 150, pixel_sigma_px=0.4, seed=1)
    sfmcpp.write(truth, tmp_path / "start.npz")
    gps = truth.centres + np.random.default_rng(1).normal(0, 0.1, truth.centres.shape)
    np.savetxt(tmp_path / "gps.csv", gps, delimiter=",", header="x,y,z", comments="")
    arrays, report = tmp_path / "blocks.npz", tmp_path / "report.json"
    files = ("--gps", tmp_path / "gps.csv", "--covariances", arrays, "--report", report)
    assert run_here("solve", tmp_path / "start.npz", *files).returncode == 0
    with np.load(arrays) as found:
        variances = np.diagonal(found["cameras"], axis1=1, axis2=2)[:, 3:6] * found["variance_factor"]
    told = strict_json(report)
    assert np.sqrt(variances.mean()) == pytest.approx(told["gps"]["accuracy_m"], rel=0.02)
    assert told["covariances"]["free_freedoms"] == 0


def test_covariances_that_would_take_too_long_are_left_out_or_refused_before_the_solve(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source, table = write_noisy_circle(tmp_path), tmp_path / "sigmas.csv"
    monkeypatch.setattr(covariance_files, "MOST_PRODUCTS", 36 * 60 - 1)
    result = run_here("solve", source, "--covariances", table)
    assert result.returncode == 0
    assert "of cameras alone: the points are too many" in result.stdout
    assert [row["kind"] for row in rows_of(table)] == ["camera"] * 6
    table.unlink()
    assert covariance_files.MOST_COLUMNS >= 6 * 3_000  # three thousand cameras
    monkeypatch.setattr(covariance_files, "MOST_COLUMNS", 35)
    result = run_here("solve", source, "--covariances", table)
    assert result.returncode == 2
    assert "covariances of 36 free parameters of cameras: must be at most 35" in result.stderr
    assert not table.exists()


def test_what_is_written_without_its_uncertainties_is_told(tmp_path: Path) -> None:
    problem = sfmcpp.circle_scene(6, 60, pixel_sigma_px=0.5, seed=0)
    problem.sigma_px = np.full(problem.num_observations, 0.5)
    sfmcpp.write(problem, tmp_path / "start.npz")
    note = "has no place for the uncertainties of observations"
    for command, option in (("solve", "-o"), ("doctor", "--fix")):
        told = {
            name: run_here(command, tmp_path / "start.npz", option, tmp_path / name)
            for name in ("out.txt", "out.npz", "out.ply")
        }
        assert [result.returncode for result in told.values()] == [0, 0, 0], command
        assert [note in result.stderr for result in told.values()] == [True, False, False], command
