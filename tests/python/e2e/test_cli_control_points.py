"""`sfmcpp solve --gcp`: the result is in the world of the survey."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import sfmcpp
from cli_helpers import run_here, strict_json
from sfmcpp.model.arrays import FloatArray

UTM = np.array([691_500.0, 5_334_500.0, 520.0])


@pytest.fixture
def survey(tmp_path: Path) -> tuple[Path, Path, FloatArray]:
    """A model in a frame of its own, a file of six control and two check points, the other true points."""
    truth = sfmcpp.circle_scene(30, 200, pixel_sigma_px=0.5, radius_m=60.0, cube_m=30.0, seed=5)
    truth.metadata.image_names = [f"IMG_{k:03d}.jpg" for k in range(30)]
    model = truth.with_points(np.arange(8, 200))
    model.cameras[:, :, 3] /= 2
    model.points /= 2
    sfmcpp.write(model, tmp_path / "start.npz")
    lines = ["name,x,y,z,image,u,v,check"]
    for row in np.flatnonzero(truth.point_index < 8):
        point = int(truth.point_index[row])
        place = (*(truth.points[point] + UTM).tolist(), f"IMG_{truth.camera_index[row]:03d}.jpg")
        lines.append(f"p{point}," + ",".join(map(str, (*place, *truth.pixels[row], int(point > 5)))))
    table = tmp_path / "gcp.csv"
    table.write_text("\n".join(lines) + "\n")
    return tmp_path / "start.npz", table, truth.points[8:] + UTM


def test_a_file_ends_in_the_world_of_its_control_points(
    survey: tuple[Path, Path, FloatArray], tmp_path: Path
) -> None:
    source, table, points = survey
    output, report, where = tmp_path / "out.npz", tmp_path / "report.json", tmp_path / "where.csv"
    files = ("-o", output, "--report", report, "--positions-out", where)
    result = run_here("solve", source, "--gcp", table, *files)
    assert (result.returncode, result.stderr) == (0, "")
    told = strict_json(report)["control"]
    assert told["origin"] == {"x_m": 691_000.0, "y_m": 5_334_000.0, "z_m": 0.0}
    assert max(told["rms_of_checks_m"]) < 0.05
    assert [point["check"] for point in told["points"]] == [False] * 6 + [True] * 2
    there = sfmcpp.read(output).points[: len(points)] + list(told["origin"].values())
    assert np.linalg.norm(there - points, axis=1).mean() < 0.05
    shown = [" ".join(line.split()) for line in result.stdout.splitlines()]
    assert any(line.startswith("control points 6; off by") for line in shown)
    assert any(line.startswith("check points 2; off by") for line in shown)
    assert where.read_text().splitlines()[1].startswith("IMG_000.jpg,69")


def test_what_is_told_of_control_points_is_that_of_the_model_that_is_written(
    survey: tuple[Path, Path, FloatArray], tmp_path: Path
) -> None:
    source, table, _ = survey
    lines = table.read_text().splitlines()
    # Some points have more marks than others, and p0 has worse ones.
    kept = [line for k, line in enumerate(lines[1:]) if not line.startswith(("p1,", "p2,")) or k % 5]
    for k, line in enumerate(kept):
        name, x, y, z, image, u, v, check = line.split(",")
        if name == "p0":
            kept[k] = ",".join((name, x, y, z, image, str(float(u) + 3 * (-1) ** k), v, check))
    table.write_text("\n".join([lines[0], *kept]) + "\n")
    problem = sfmcpp.perturb(sfmcpp.read(source), point_sigma_m=0.2, position_sigma_m=0.2, seed=1)
    problem.metadata.image_names = sfmcpp.read(source).metadata.image_names
    sfmcpp.write(problem, source)
    output, report = tmp_path / "out.npz", tmp_path / "report.json"
    files = ("-o", output, "--report", report, "--method", "gradient-descent", "--max-iterations", "3")
    result = run_here("solve", source, "--gcp", table, *files)
    summary = strict_json(report)
    assert summary["final_cost"] < 0.999 * summary["initial_cost"]  # the last solve has moved them
    assert summary["input"]["points"] == problem.num_points
    told, solved = summary["control"], sfmcpp.read(output)
    surveyed = {line.split(",")[0]: np.array(line.split(",")[1:4], dtype=float) for line in kept}
    metres = np.array([surveyed[point["name"]] for point in told["points"]])
    first = problem.num_points
    offsets = solved.points[first:] + list(told["origin"].values()) - metres
    np.testing.assert_allclose([point["offset_m"] for point in told["points"]], offsets, atol=1e-8)
    of_marks = solved.point_index >= first
    errors = np.linalg.norm(sfmcpp.ba.residuals_px(solved)[of_marks], axis=1)
    points = solved.point_index[of_marks] - first
    means = np.bincount(points, errors) / np.bincount(points)
    np.testing.assert_allclose([point["error_px"] for point in told["points"]], means, rtol=1e-9)
    shown = [" ".join(line.split()) for line in result.stdout.splitlines()]
    assert abs(errors.mean() / means.mean() - 1) > 0.002
    assert f"marks {len(errors)}; {errors.mean():.3g} px from their images (mean)" in shown


@pytest.mark.parametrize("target", ["--positions-out", "--covariances", "--report"])
@pytest.mark.parametrize("option", ["--gcp", "--gps"])
def test_a_file_of_the_survey_is_never_replaced(
    survey: tuple[Path, Path, FloatArray], option: str, target: str
) -> None:
    source, table, _ = survey
    if option == "--gps":
        table.write_text(
            "name,x,y,z\n" + "".join(f"IMG_{k:03d}.jpg,{k % 7},{k % 5},{k}\n" for k in range(30))
        )
    before = table.read_bytes()
    refused = run_here("solve", source, option, table, target, table)
    assert (refused.returncode, table.read_bytes() == before) == (2, True)
    assert refused.stderr.startswith(f"sfmcpp: error: {table}: is named twice")


def test_what_does_not_go_together_is_refused_in_one_line(
    survey: tuple[Path, Path, FloatArray], tmp_path: Path
) -> None:
    source, table, _ = survey
    gps = run_here("solve", source, "--gcp", table, "--gps", table)
    assert gps.returncode == 2
    assert "--gcp: must be without --gps" in gps.stderr
    table.write_text(table.read_text().replace("IMG_", "DJI_"))
    other = run_here("solve", source, "--gcp", table)
    assert other.returncode == 2
    assert other.stderr.startswith(f"sfmcpp: error: {table}: none of the marked images (DJI_")
    geojson = run_here("solve", source, "--gcp", table, "--positions-out", tmp_path / "a.geojson")
    assert geojson.returncode == 2
    missing = run_here("solve", source, "--gcp", tmp_path / "none.csv")
    assert (missing.returncode, "no such file" in missing.stderr) == (2, True)
