"""Small files of text that would take for ever, or end in an error of Python, are refused by name."""

from __future__ import annotations

import pickle
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from sfmcpp import DatasetError, circle_scene, read, rig_walk_scene, write
from sfmcpp.sources.io.position_csv import read_position_csv
from sfmcpp.sources.io.sensor_csv import read_sensor_csv

# Refused in milliseconds; each took minutes.
SECONDS = 5.0
WORD, BLANKS = '{"a":' * 30_000, " " * 6000
MRK = "1\t434914.0\t[2100]\t-14,N\t7,E\t190,V\t46.5,Lat\t9.2,Lon\t500.1,Ellh\t0.01, 0.01, 0.03\t50,Q\n"


@pytest.mark.parametrize(
    ("name", "text", "reader"),
    [
        ("a.MRK", f"{MRK}2\t{WORD}\n", read_position_csv),
        ("a.MRK", f"1\t{WORD}\n{MRK}", read_position_csv),
        ("a.MRK", "1\t" + "0,Lat\t" * 3000 + "0,Lon\t" * 3000 + "\n", read_position_csv),
        ("a.MRK", f"{MRK}{'1' * 5000}{MRK[1:]}", read_position_csv),
        ("a.csv", f"name,x{BLANKS}y,y,z\na.jpg,1,2,3\n", read_position_csv),
        ("a.csv", f"t [s],speed{BLANKS}x [m/s]\n0,1\n", read_sensor_csv),
        ("a.csv", f"t [s],speed{'(' * 100_000}\n0,1\n", read_sensor_csv),
    ],
)
def test_lines_that_patterns_could_divide_in_many_ways(
    tmp_path: Path, name: str, text: str, reader: Callable[[Path], object]
) -> None:
    (tmp_path / name).write_text(text)
    begin = time.process_time()
    with pytest.raises(DatasetError, match=name):
        reader(tmp_path / name)
    assert time.process_time() - begin < SECONDS


@pytest.mark.parametrize("number", ["1" * 30, "-1", str(2**32), str(2**64)])
@pytest.mark.parametrize(("name", "column"), [("rigs.txt", 0), ("rigs.txt", 3), ("frames.txt", 0)])
def test_numbers_of_rigs_beyond_those_of_colmap(tmp_path: Path, number: str, name: str, column: int) -> None:
    write(rig_walk_scene(6, 100, camera_model="perspective", seed=0), tmp_path, format="colmap-text")
    lines = (tmp_path / name).read_text().splitlines()
    words = lines[-1].split()
    words[column] = number
    (tmp_path / name).write_text("\n".join([*lines[:-1], " ".join(words)]) + "\n")
    with pytest.raises(
        DatasetError, match=f"{name}:{len(lines)}: .*{number} must be a whole number from 0 to"
    ):
        read(tmp_path)


@pytest.mark.parametrize(
    "text", ["[" * 100_000, '{"latitude_deg": 1' + "0" * 400 + ', "longitude_deg": 9, "height_m": 1}']
)
def test_an_origin_that_is_nested_too_deeply_or_out_of_this_world(tmp_path: Path, text: str) -> None:
    write(circle_scene(3, 20, seed=0), tmp_path / "model")
    (tmp_path / "model" / "sfmcpp_origin.json").write_text(text)
    with pytest.raises(DatasetError, match=r"sfmcpp_origin\.json: "):
        read(tmp_path / "model")


@pytest.mark.parametrize("cell", ["y" * 100_000, "é" * 50_000])
def test_a_line_without_end_is_not_quoted_to_its_end(tmp_path: Path, cell: str) -> None:
    (tmp_path / "a.csv").write_text(f"name,x,y,z\na.jpg,1,{cell},3\n")
    with pytest.raises(
        DatasetError, match=r"a\.csv:2: y is '(y|é)+ \[…\] (y|é)+': must be a finite number"
    ) as error:
        read_position_csv(tmp_path / "a.csv")
    assert len(str(error.value)) < 4000
    copied = pickle.loads(pickle.dumps(error.value))
    assert (str(copied), copied.line) == (str(error.value), 2)
