"""`sfmcpp solve --gps`: the result is in the world of the positions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import sfmcpp
from cli_helpers import run_here, strict_json
from sfmcpp.errors import DatasetError
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sensors import east_north_up, geodetic_of
from sfmcpp.sources.io.position_csv import read_position_csv
from sfmcpp.sources.synthetic.photos.photo_files import ExifContent, write_photo

UTM = np.array([691_500.0, 5_334_500.0, 520.0])


def scene(folder: Path, names: bool) -> tuple[Path, FloatArray]:
    """A file of a problem that is perturbed and twice as small as its centres, and these in the world."""
    truth = sfmcpp.circle_scene(40, 200, pixel_sigma_px=0.5, radius_m=60.0, cube_m=30.0, seed=5)
    problem = sfmcpp.perturb(truth, point_sigma_m=0.2, position_sigma_m=0.2, rotation_sigma_deg=0.3, seed=5)
    problem.cameras[:, :, 3] /= 2
    problem.points /= 2
    if names:
        problem.metadata.image_names = [f"IMG_{k:03d}.jpg" for k in range(40)]
    path = folder / "start.npz"
    sfmcpp.write(problem, path)
    return path, truth.centres + UTM


def write_csv(path: Path, columns: str, rows: list[list[object]]) -> Path:
    path.write_text("\n".join([columns, *(",".join(map(str, row)) for row in rows)]) + "\n")
    return path


@pytest.mark.parametrize("names", [True, False])
def test_a_file_ends_in_the_world_of_its_positions(tmp_path: Path, names: bool) -> None:
    source, centres = scene(tmp_path, names)
    gps = centres + np.random.default_rng(0).normal(0, 0.3, centres.shape)
    gps[11] += [0.0, 8.0, 0.0]
    labels = [f"IMG_{k:03d}.jpg" if names else k for k in range(40)]
    rows = [[label, *row] for label, row in zip(labels, gps, strict=True)][::-1]
    table = write_csv(tmp_path / "gps.csv", "name,x,y,z" if names else "index,x,y,z", rows)
    output, report = tmp_path / "out.npz", tmp_path / "report.json"
    result = run_here("solve", source, "--gps", table, "-o", output, "--report", report)
    assert (result.returncode, result.stderr) == (0, "")
    told = strict_json(report)["gps"]
    assert told["outliers"] == [str(labels[11])]
    assert told["sigma_m"] == pytest.approx(0.3, rel=0.2)
    assert told["origin"] == {"x_m": 691_000.0, "y_m": 5_334_000.0, "z_m": 0.0}
    there = sfmcpp.read(output).centres + list(told["origin"].values())
    assert np.linalg.norm(there - centres, axis=1).max() < 0.3
    shown = [" ".join(line.split()) for line in result.stdout.splitlines()]
    assert f"GPS left out {labels[11]}" in shown
    assert f"warning 1 position disagrees with the images: left out {labels[11]}" in shown
    assert "origin x_m 691000, y_m 5334000, z_m 0" in shown


def test_positions_without_names_or_numbers_go_by_their_line_and_have_deviations(tmp_path: Path) -> None:
    source, centres = scene(tmp_path, names=True)
    sigmas = np.where(np.arange(40) % 2, 0.02, 1.0)[:, None] * [1.0, 1.0, 2.0]
    gps = centres + np.random.default_rng(1).normal(0, 1, centres.shape) * sigmas
    table = write_csv(
        tmp_path / "gps.csv", "x,y,z,sigma_x,sigma_y,sigma_z", np.hstack([gps, sigmas]).tolist()
    )
    output, report = tmp_path / "out.npz", tmp_path / "report.json"
    assert run_here("solve", source, "--gps", table, "-o", output, "--report", report).returncode == 0
    told = strict_json(report)["gps"]
    assert told["sigma_m"] == pytest.approx(told["stated_sigma_m"], rel=0.25)
    there = sfmcpp.read(output).centres + list(told["origin"].values())
    assert np.linalg.norm(there - centres, axis=1).max() < 0.1


def test_positions_are_written_in_the_frame_of_those_given(tmp_path: Path) -> None:
    source, centres = scene(tmp_path, names=True)
    gps = centres + np.random.default_rng(2).normal(0, 0.1, centres.shape)
    table = write_csv(tmp_path / "utm.csv", "x,y,z", gps.tolist())
    written = tmp_path / "out.csv"
    assert run_here("solve", source, "--gps", table, "--positions-out", written).returncode == 0
    found = read_position_csv(written)
    assert list(found.positions)[:2] == ["IMG_000.jpg", "IMG_001.jpg"]
    np.testing.assert_allclose(list(found.positions.values()), centres, atol=0.1)
    sigmas = np.array(list((found.sigmas or {}).values()))
    misses = (np.array(list(found.positions.values())) - centres) / sigmas
    assert 0.5 < np.sqrt((misses**2).mean()) < 2  # of 120 correlated numbers

    origin = [46.5, 9.25, 800.0]
    geodetic = geodetic_of(centres - UTM, origin)
    table = write_csv(tmp_path / "wgs84.csv", "lat,lon,height", geodetic.tolist())
    places = tmp_path / "out.geojson"
    assert run_here("solve", source, "--gps", table, "--positions-out", places).returncode == 0
    features = strict_json(places)["features"]
    told = np.array([feature["geometry"]["coordinates"] for feature in features])[:, [1, 0, 2]]
    properties = features[0]["properties"]
    by_axis = [f"residual_{axis}" for axis in "enu"]
    assert set(properties) == {"name", "sigma_e", "sigma_n", "sigma_u", "residual", "left_out", *by_axis}
    assert np.linalg.norm([properties[name] for name in by_axis]) == pytest.approx(properties["residual"])
    np.testing.assert_allclose(east_north_up(told, origin), centres - UTM, atol=0.05)


def test_residuals_are_those_of_the_model_that_is_written(tmp_path: Path) -> None:
    """Also where a limit leaves the last solve much to do after the positions were fitted."""
    source, centres = scene(tmp_path, names=True)
    gps = centres + np.random.default_rng(4).normal(0, 0.3, centres.shape)
    table = write_csv(tmp_path / "gps.csv", "x,y,z", gps.tolist())
    output, report, places = (tmp_path / name for name in ("out.npz", "report.json", "places.csv"))
    files = ("-o", output, "--report", report, "--positions-out", places)
    limits = ("--method", "gradient-descent", "--max-iterations", "3")
    assert run_here("solve", source, "--gps", table, *files, *limits).returncode == 0
    summary = strict_json(report)
    assert summary["final_cost"] < 0.999 * summary["initial_cost"]  # it has moved
    told, solved = summary["gps"], sfmcpp.read(output)
    offsets = solved.centres + list(told["origin"].values()) - gps
    np.testing.assert_allclose(list(told["offsets_m"].values()), offsets, atol=1e-8)
    distances = np.linalg.norm(offsets, axis=1)
    np.testing.assert_allclose(list(told["residuals_m"].values()), distances, atol=1e-8)
    rows = [line.split(",") for line in places.read_text().splitlines()]
    column = rows[0].index("residual")
    np.testing.assert_allclose([float(row[column]) for row in rows[1:]], distances, atol=1e-8)


@pytest.mark.parametrize("output", ["out.npz", "model"])
def test_a_model_keeps_its_origin(tmp_path: Path, output: str) -> None:
    source, centres = scene(tmp_path, names=True)
    origin = [46.5, 9.25, 800.0]
    table = write_csv(tmp_path / "gps.csv", "lat,lon,height", geodetic_of(centres - UTM, origin).tolist())
    model, again = tmp_path / output, tmp_path / "again.geojson"
    assert run_here("solve", source, "--gps", table, "-o", model).returncode == 0
    solved = run_here("solve", model, "--positions-out", again)
    assert solved.returncode == 0
    assert "is georeferenced by positions that this solve does not use" in solved.stderr
    features = strict_json(again)["features"]
    told = np.array([feature["geometry"]["coordinates"] for feature in features])[:, [1, 0, 2]]
    # Without positions, a solve leaves them by what its images tell otherwise.
    np.testing.assert_allclose(east_north_up(told, origin), centres - UTM, atol=0.5)
    assert "position, rotation and scale of the world are arbitrary" not in run_here("doctor", model).stdout
    assert run_here("solve", model, "--max-iterations", "0").stderr == ""
    assert run_here("solve", model, "--gps", table).stderr == ""
    assert run_here("convert", source, model).returncode == 0
    assert run_here("solve", model, "--positions-out", again).returncode == 2


@pytest.mark.parametrize("suffix", ["csv", "geojson"])
def test_positions_are_written_without_a_solve(tmp_path: Path, suffix: str) -> None:
    source, _ = scene(tmp_path, names=True)
    problem, origin = sfmcpp.read(source), np.array([46.5, 9.25, 800.0])
    problem.metadata.extra["origin_geodetic"] = origin
    sfmcpp.write(problem, tmp_path / "model")
    places = tmp_path / f"out.{suffix}"
    result = run_here("convert", tmp_path / "model", places)
    assert (result.returncode, result.stdout) == (0, f"{places}: positions of 40 cameras\n")
    if suffix == "csv":
        told = np.array(list(read_position_csv(places).positions.values()))
    else:
        features = strict_json(places)["features"]
        told = np.array([feature["geometry"]["coordinates"] for feature in features])[:, [1, 0, 2]]
    np.testing.assert_allclose(east_north_up(told, origin), problem.centres, atol=1e-6)


def test_a_problem_of_no_positions_becomes_no_geojson_and_no_other_file(tmp_path: Path) -> None:
    source, _ = scene(tmp_path, names=False)
    refused = run_here("convert", source, tmp_path / "own.geojson")
    assert refused.returncode == 2
    assert "GeoJSON holds latitudes and longitudes" in refused.stderr
    assert not (tmp_path / "own.geojson").exists()


def test_a_table_of_positions_holds_no_images_that_are_called_the_same(tmp_path: Path) -> None:
    """One of them was missing in the table, without a word."""
    source, _ = scene(tmp_path, names=True)
    problem = sfmcpp.read(source)
    problem.metadata.image_names[3] = "IMG_004.jpg"
    sfmcpp.write(problem, source)
    for arguments in (("convert", source, tmp_path / "p.csv"), ("solve", source, "--positions-out", "p.csv")):
        refused = run_here(*arguments, cwd=tmp_path)
        assert refused.returncode == 2
        assert "p.csv: 2 images are called 'IMG_004.jpg'" in refused.stderr
        assert not (tmp_path / "p.csv").exists()


def test_positions_of_exif_are_those_of_a_folder_of_photos(tmp_path: Path) -> None:
    source, centres = scene(tmp_path, names=True)
    origin = np.array([46.5, 9.25, 800.0])
    picture = np.zeros((6, 8, 3), dtype=np.uint8)
    for name, place in zip(
        sfmcpp.read(source).metadata.image_names or (), geodetic_of(centres - UTM, origin), strict=True
    ):
        write_photo(tmp_path / "photos" / name, picture, ExifContent(position=tuple(place.tolist())))
    output = tmp_path / "out.npz"
    assert run_here("solve", source, "--gps", tmp_path / "photos", "-o", output).returncode == 0
    solved = sfmcpp.read(output)
    places = geodetic_of(solved.centres, solved.metadata.extra["origin_geodetic"])
    np.testing.assert_allclose(east_north_up(places, origin), centres - UTM, atol=0.1)
    hint = run_here("solve", source, "--gps", "exif", cwd=tmp_path).stderr
    assert "--gps FOLDER" in hint


def test_an_origin_that_is_damaged_is_named(tmp_path: Path) -> None:
    source, _ = scene(tmp_path, names=True)
    sfmcpp.write(sfmcpp.read(source), tmp_path / "model")
    path = tmp_path / "model" / "sfmcpp_origin.json"
    for text in ("{", "[1]", '{"x_m": 1, "y_m": 2}', '{"x_m": 1, "y_m": 2, "z_m": "up"}'):
        path.write_text(text)
        with pytest.raises(DatasetError, match=r"sfmcpp_origin\.json"):
            sfmcpp.read(tmp_path / "model")


def test_positions_of_a_problem_in_a_frame_of_its_own_are_no_geojson(tmp_path: Path) -> None:
    source, _ = scene(tmp_path, names=False)
    assert run_here("solve", source, "--positions-out", tmp_path / "own.csv").returncode == 0
    assert list(read_position_csv(tmp_path / "own.csv").positions) == [str(k) for k in range(40)]
    refused = run_here("solve", source, "--positions-out", tmp_path / "own.geojson")
    assert refused.returncode == 2
    assert "GeoJSON holds latitudes and longitudes" in refused.stderr
    projective = ("--camera-model", "projective", "--positions-out", tmp_path / "p.csv")
    assert "projective cameras have no positions" in run_here("solve", source, *projective).stderr


def test_the_file_of_positions_is_not_replaced(tmp_path: Path) -> None:
    source, centres = scene(tmp_path, names=False)
    table = write_csv(tmp_path / "gps.csv", "x,y,z", centres.tolist())
    before = table.read_text()
    assert run_here("solve", source, "--gps", table, "--positions-out", table).returncode == 2
    assert table.read_text() == before


def test_what_does_not_go_together_is_said_in_a_line(tmp_path: Path) -> None:
    source, centres = scene(tmp_path, names=True)
    alien = write_csv(tmp_path / "alien.csv", "name,x,y,z", [["x.jpg", 1, 2, 3]])
    few = write_csv(tmp_path / "few.csv", "index,x,y,z", [[k, *centres[k]] for k in range(3)])
    degrees = geodetic_of(centres - UTM, [46.84, -91.99, 198.0])[:, [1, 0, 2]]
    named = write_csv(tmp_path / "degrees.csv", "x,y,z", degrees.tolist())
    looks = (
        "x and y are -91.99 and 46.84 to within 0.0016, which look like degrees: must be metres, or be named"
    )
    for table, reason in (
        (named, f"{looks} lat, lon, height (geodetic=True)"),
        (alien, "none of its names (x.jpg) is the name of an image (IMG_000.jpg, IMG_001.jpg, IMG_002.jpg)"),
        (few, "3 images of the model have a position, 5 are needed"),
        (tmp_path / "missing.csv", "no such file or directory"),
    ):
        result = run_here("solve", source, "--gps", table)
        assert result.returncode == 2
        assert result.stderr == f"sfmcpp: error: {table}: {reason}\n"


def receiver_scene(folder: Path) -> tuple[Path, FloatArray, FloatArray]:
    """A problem with names of a drone, its centres as latitudes, and these with errors of the receiver."""
    source, centres = scene(folder, names=True)
    problem = sfmcpp.read(source)
    problem.metadata.image_names = [f"DJI_20260803132556_{k + 1:04d}_V.JPG" for k in range(40)]
    sfmcpp.write(problem, source)
    origin, noise = [46.84, -91.99, 198.0], np.random.default_rng(4).normal(0, 0.02, centres.shape)
    return source, geodetic_of(centres - UTM, origin), geodetic_of(centres - UTM + noise, origin)


def test_photos_are_found_by_the_numbers_of_an_mrk(tmp_path: Path) -> None:
    source, truth, gps = receiver_scene(tmp_path)
    told = "{},Lat\t{},Lon\t{},Ellh\t0.02, 0.02, 0.02\t50,Q"
    lines = [
        f"{k + 1}\t37{k}.5\t[2041]\t-2,N\t4,E\t9,V\t" + told.format(*gps[k]) for k in range(40) if k != 7
    ]
    (tmp_path / "t.MRK").write_text("\n".join(lines[::-1]) + "\n")
    output, report = tmp_path / "out.npz", tmp_path / "report.json"
    result = run_here("solve", source, "--gps", tmp_path / "t.MRK", "-o", output, "--report", report)
    assert (result.returncode, strict_json(report)["gps"]["stated_sigma_m"]) == (0, 0.02)
    solved = sfmcpp.read(output)
    there = geodetic_of(solved.centres, solved.metadata.extra["origin_geodetic"])
    assert np.linalg.norm(east_north_up(there, truth[0]) - east_north_up(truth, truth[0]), axis=1).max() < 0.1
    assert "39: latitude, longitude, height, with standard deviations" in " ".join(
        run_here("info", tmp_path / "t.MRK").stdout.split()
    )


def test_a_pos_has_a_line_for_each_image(tmp_path: Path) -> None:
    source, truth, gps = receiver_scene(tmp_path)
    header = "%  GPST  latitude(deg) longitude(deg)  height(m)   Q  ns\n"
    rows = [f"2056 54743{k}.5 {' '.join(map(str, row))} 1 12\n" for k, row in enumerate(gps)]
    (tmp_path / "events.pos").write_text(header + "".join(rows))
    (tmp_path / "more.pos").write_text(header + "".join(rows + rows))
    output = tmp_path / "out.npz"
    assert run_here("solve", source, "--gps", tmp_path / "events.pos", "-o", output).returncode == 0
    solved = sfmcpp.read(output)
    there = geodetic_of(solved.centres, solved.metadata.extra["origin_geodetic"])
    assert np.linalg.norm(east_north_up(there, truth[0]) - east_north_up(truth, truth[0]), axis=1).max() < 0.1
    refused = run_here("solve", source, "--gps", tmp_path / "more.pos")
    assert refused.returncode == 2
    assert "80 positions for 40 images: without names there must be one for each" in refused.stderr
