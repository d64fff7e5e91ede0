"""`sfmcpp demo`, `sfmcpp convert`, `--help` and `--version`."""

from __future__ import annotations

import subprocess
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np
import pytest

import sfmcpp
from cli_helpers import is_one_error_line, noisy_circle, run, run_here, strict_json, write_noisy_circle
from sfmcpp.sources.synthetic import circle_scene, perturb

PICTURES = ["convergence.png", "scene.png"]


def test_the_demo_solves_the_thesis_scene_down_to_its_noise(tmp_path: Path) -> None:
    result = run("demo", "-o", "nested/demo", cwd=tmp_path)
    folder = tmp_path / "nested/demo"
    assert (result.returncode, result.stderr) == (0, "")
    assert result.stdout.splitlines()[-1] == f"The demo is in {folder}"
    names = sorted(path.name for path in folder.iterdir())
    assert names == sorted([*PICTURES, "problem.npz", "report.json", "result.npz", "result.ply", "view.html"])
    content = strict_json(folder / "report.json")
    assert content["input"] == {
        "path": "nested/demo/problem.npz",
        "cameras": 30,
        "points": 500,
        "observations": 15_000,
    }
    # 30,000 residuals of variance 1 less 1,673 free unknowns; two-sided at four standard errors.
    freedom = 2 * 15_000 - (6 * 30 + 3 * 500 - 7)
    assert 2 * content["final_cost"] == pytest.approx(freedom, abs=4 * np.sqrt(2 * freedom))


def test_the_demo_does_without_pictures_where_nothing_draws_them(tmp_path: Path) -> None:
    code = (
        "import importlib.util, sys; from sfmcpp.cli.main import main; find = importlib.util.find_spec;"
        "importlib.util.find_spec = lambda name, *rest: None if name == 'matplotlib' else find(name, *rest);"
        "sys.modules['matplotlib'] = None; sys.exit(main(['demo', '-o', sys.argv[1]]))"
    )
    result = subprocess.run([sys.executable, "-c", code, tmp_path], capture_output=True, text=True)
    assert (result.returncode, result.stderr) == (0, "")
    assert "sfmcpp[plot]" in result.stdout
    names = {path.name for path in tmp_path.iterdir()}
    assert "view.html" in names
    assert names.isdisjoint(PICTURES)


def test_the_demo_keeps_the_noisy_start_it_was_asked_for(tmp_path: Path) -> None:
    assert run_here("demo", "-o", tmp_path, "--seed", "5").returncode == 0
    start = sfmcpp.read(tmp_path / "problem.npz")
    expected = perturb(
        circle_scene(seed=5), point_sigma_m=0.5, position_sigma_m=1.0, rotation_sigma_deg=15.0, seed=5
    )
    np.testing.assert_array_equal(start.points, expected.points)
    np.testing.assert_array_equal(start.cameras, expected.cameras)
    np.testing.assert_array_equal(start.pixels, expected.pixels)


def test_a_demo_folder_that_is_a_file_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    result = run_here("demo", "-o", tmp_path / "file")
    assert result.returncode == 2
    assert is_one_error_line(result)
    assert f"{tmp_path / 'file'}: " in result.stderr


@pytest.mark.parametrize("name", ["copy.txt", "copy.txt.gz", "copy.out", "model"])
def test_convert_keeps_the_cost(tmp_path: Path, name: str) -> None:
    source = write_noisy_circle(tmp_path)
    result = run_here("convert", source, tmp_path / name)
    assert (result.returncode, result.stderr) == (0, "")
    converted = sfmcpp.cost(sfmcpp.read(tmp_path / name))
    assert converted == pytest.approx(sfmcpp.cost(sfmcpp.read(source)), rel=1e-9)


@pytest.mark.parametrize(
    ("name", "held", "left_out"),
    [
        ("transforms.json", "6 cameras (transforms)", "60 points, 360 observations"),
        (
            "copy.ply",
            "6 cameras, 60 points (ply)",
            "360 observations, rotations and intrinsics, image names, image sizes",
        ),
        ("copy.out", "6 cameras, 60 points, 360 observations (bundler)", "image names, image sizes"),
    ],
)
def test_convert_tells_what_the_format_has_no_place_for(
    tmp_path: Path, name: str, held: str, left_out: str
) -> None:
    scene = noisy_circle(camera_model="bal")
    scene.metadata.image_names = [f"{i}.jpg" for i in range(6)]
    sfmcpp.write(scene, tmp_path / "start.npz")
    result = run_here("convert", tmp_path / "start.npz", tmp_path / name)
    lines = result.stdout.splitlines()
    assert lines[0] == f"{tmp_path / name}: {held}"
    assert lines[1].endswith(f"has no place for it: {left_out}")


@pytest.mark.parametrize("name", ["a.txt", "a.out", "a.nvm", "acams.txt", "a.g2o", "a.sfm"])
def test_convert_tells_where_cameras_lose_what_they_share(tmp_path: Path, name: str) -> None:
    for scene in (
        noisy_circle(camera_model="bal"),
        noisy_circle(camera_model="bal").with_shared_intrinsics(),
    ):
        sfmcpp.write(scene, tmp_path / "start.npz")
        told = run_here("convert", tmp_path / "start.npz", tmp_path / name).stdout
        shared = len(scene.intrinsics) < scene.num_cameras
        kept = len(sfmcpp.read(tmp_path / name).intrinsics) == len(scene.intrinsics)
        assert ("shared intrinsics" in told) == (shared and not kept)


def test_convert_tells_of_pixels_that_become_square(tmp_path: Path) -> None:
    scene = noisy_circle(camera_model="perspective")
    for aspect, skew in ((1.0, 0.0), (1.001, 0.0), (1.0, 0.1)):
        names = scene.intrinsic_names
        scene.intrinsics[:, [names.index("aspect"), names.index("skew")]] = aspect, skew
        sfmcpp.write(scene, tmp_path / "a.npz")
        told = run_here("convert", tmp_path / "a.npz", tmp_path / "a.nvm").stderr
        assert ("square pixels" in told) == ((aspect, skew) != (1.0, 0.0))


@pytest.mark.parametrize("name", ["a.g2o", "a.nvm"])
def test_convert_tells_of_pixels_that_lose_their_distortion(tmp_path: Path, name: str) -> None:
    scene = noisy_circle(camera_model="perspective")
    for k1, told in ((0.0, ""), (0.1, f"note: {name}: pixels are as cameras without distortion")):
        scene.intrinsics[:, scene.intrinsic_names.index("k1")] = k1
        sfmcpp.write(scene, tmp_path / "a.npz")
        result = run_here("convert", "a.npz", name, cwd=tmp_path)
        assert result.returncode == 0
        assert told in result.stderr if told else result.stderr == ""


def test_convert_points_to_the_images(tmp_path: Path) -> None:
    scene = noisy_circle()
    scene.metadata.image_names = [f"{i}.jpg" for i in range(6)]
    sfmcpp.write(scene, tmp_path / "start.npz")
    (tmp_path / "out").mkdir()
    words = ("--images", tmp_path / "photos")
    assert (
        run_here("convert", tmp_path / "start.npz", tmp_path / "out/transforms.json", *words).returncode == 0
    )
    frames = strict_json(tmp_path / "out/transforms.json")["frames"]
    assert frames[2]["file_path"] == "../photos/2.jpg"
    for name in ("sfm_data.json", "scene.sfm"):
        assert run_here("convert", tmp_path / "start.npz", tmp_path / "out" / name, *words).returncode == 0
    assert strict_json(tmp_path / "out/sfm_data.json")["root_path"] == str(tmp_path / "photos")
    assert strict_json(tmp_path / "out/scene.sfm")["views"][2]["path"] == str(tmp_path / "photos/2.jpg")
    assert sfmcpp.read(tmp_path / "out/sfm_data.json").metadata.image_names == scene.metadata.image_names
    refused = run_here("convert", tmp_path / "start.npz", tmp_path / "copy.ply", *words)
    assert (refused.returncode, "ply does not point to images" in refused.stderr) == (2, True)


def test_a_folder_of_a_reconstruction_leads_to_its_model(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    sfmcpp.write(noisy_circle(), tmp_path / "out/model")
    refused = run_here("solve", tmp_path / "out")
    assert refused.returncode == 2
    assert refused.stderr.endswith(f"{tmp_path / 'out/model'} is one\n")


def test_convert_writes_the_format_that_is_named(tmp_path: Path) -> None:
    source, target = write_noisy_circle(tmp_path), tmp_path / "model"
    assert run_here("convert", source, target, "--format", "colmap-text").returncode == 0
    assert sorted(path.name for path in target.iterdir()) == ["cameras.txt", "images.txt", "points3D.txt"]
    refused = run_here("convert", source, target, "--format", "strecha")
    assert (refused.returncode, "'strecha' is unknown" in refused.stderr) == (2, True)
    refused = run_here("convert", source, target, "--format", "bal", "--parts", "2")
    assert (refused.returncode, "parts have a format of their own" in refused.stderr) == (2, True)


@pytest.mark.parametrize(
    "command",
    [["convert", "model", "copy"], ["solve", "model", "--max-iterations", "1"], ["doctor", "model"]],
)
def test_second_sightings_that_count_once_are_told(tmp_path: Path, command: list[str]) -> None:
    sfmcpp.write(noisy_circle(), tmp_path / "model", format="colmap-text")
    keypoints, points = tmp_path / "model/images.txt", tmp_path / "model/points3D.txt"
    first, *images = keypoints.read_text().splitlines()
    count = len(images[1].split()) // 3
    point = images[1].split()[2]
    keypoints.write_text("\n".join([first, images[0], f"{images[1]} 1 2 {point}", *images[2:], ""]))
    head, *rows = points.read_text().splitlines()
    seen = [f"{row} 1 {count}" if row.split()[0] == point else row for row in rows]
    points.write_text("\n".join([head, *seen, ""]))
    result = run_here(*command, cwd=tmp_path)
    assert result.returncode == 0
    assert "note: model: 1 of 361 observations are second sightings" in result.stderr


def test_a_failed_conversion_is_one_line_and_writes_nothing(tmp_path: Path) -> None:
    source = tmp_path / "bad.txt"
    source.write_text("1 1\n")
    result = run_here("convert", source, tmp_path / "out.npz")
    assert result.returncode == 2
    assert is_one_error_line(result)
    assert f"{source}:" in result.stderr
    assert list(tmp_path.iterdir()) == [source]


def test_the_version_is_that_of_the_package() -> None:
    result = run("--version")
    assert (result.returncode, result.stdout) == (0, f"sfmcpp {sfmcpp.__version__}\n")
    try:
        assert version("sfmcpp") == sfmcpp.__version__
    except PackageNotFoundError:
        pytest.skip("the package is not installed")


@pytest.mark.parametrize("arguments", [["--help"], ["solve", "--help"], ["--version"]])
def test_help_imports_nothing_heavy(arguments: list[str]) -> None:
    code = (
        "import sys; from sfmcpp.cli.main import main; code = main(sys.argv[1:]);"
        "heavy = {'matplotlib', 'rich', 'scipy'} & set(sys.modules);"
        "sys.exit(f'{code} {heavy}' if code or heavy else 0)"
    )
    result = subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True)
    assert (result.returncode, result.stderr) == (0, "")


@pytest.mark.parametrize("option", ["--method", "--linear-solver", "--loss", "--gauge", "--max-seconds"])
def test_help_tells_every_option(option: str) -> None:
    assert option in run_here("solve", "--help").stdout
