#!/usr/bin/env python3
"""Usage: mutate_inputs.py [--inputs N] [--seed S] [--first K] [FILE ...]: every reader on damaged files.

The N files are shared among the readers, or those of the FILEs named, in rounds. A damaged file is a good one
with some bytes changed, left out, repeated or cut off, numbers replaced, or a piece of it elsewhere, too. It
may read, or be refused with an error of the package; anything else is a fault: it is printed with the numbers
that the file was made from, and the program ends with 1. Files are read in processes of their own, with a
limit on memory (4 GB) and on time (5 s of work, and a minute by the clock). Every few seconds a line says how
far it is; a run that is stopped (Ctrl-C) prints its table, and the K to go on with.
"""

from __future__ import annotations

import argparse
import os
import re
import resource
import signal
import sys
import tempfile
import time
import zipfile
from collections import Counter
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from unittest import mock

import numpy as np
from PIL import Image
from scipy.io import savemat

import sfmcpp
from sfmcpp.errors import SfmcppError
from sfmcpp.map.files import read_map
from sfmcpp.sources.bags import unpack_bag
from sfmcpp.sources.cameras import read_intrinsics
from sfmcpp.sources.io.image_tracks import read_image_tracks
from sfmcpp.sources.io.mat_files import mat_variables
from sfmcpp.sources.io.position_csv import read_position_csv
from sfmcpp.sources.io.sensor_csv import read_sensor_csv
from sfmcpp.sources.io.track_files import read_tracks
from sfmcpp.sources.io.trajectories import read_trajectory
from sfmcpp.sources.mounting_files import mounting_of
from sfmcpp.sources.vision import open_frames, open_photos
from sfmcpp.study.evaluation.image_poses import read_image_poses

SECONDS, SECONDS_BY_THE_CLOCK, MEMORY_BYTES, BATCH = 5, 60, 4 << 30, 200
SECONDS_BETWEEN_LINES = 5
OUTCOMES = ("read", "refused", "raw exception", "too slow", "killed")
FAULTS = OUTCOMES[2:]
Reader = Callable[[Path], object]

TEXTS: dict[str, tuple[str, Reader]] = {
    "tracks.csv": (
        "# sfmcpp tracks\n# intrinsics: f=700 cx=300 cy=200\nt_s,frame,track,u,v\n0,0,1,2,3\n0.1,1,,,\n",
        read_tracks,
    ),
    "table.txt": ("image track x y\n0 0 1 2\n1 0 3 4\n", read_image_tracks),
    "viff.xy": ("1 2 -1 -1\n3 4 5 6\n", read_image_tracks),
    "sensors.csv": (
        "t [s],speed [km/h],wx [deg/s],wy [deg/s],wz [deg/s]\n0,36.1,0.1,0,-2.5\n0.04,36,,,\n0.1,30,0,0,1\n",
        read_sensor_csv,
    ),
    "tum.txt": ("0 1 2 3 0 0 0 1\n1 2 3 4 0 0 0 1\n", read_trajectory),
    "K.txt": ("700 0 600\n0 770 180\n0 0 1\n", read_intrinsics),
    "calib.txt": ("P0: 700 0 600 0 0 700 180 0 0 0 1 0\n", read_intrinsics),
    "mounting.txt": ("1 0 0 0\n0 1 0 0\n0 0 1 0\n", mounting_of),
    "gps.csv": ('name,lat,lon,height\n"a, b.jpg",46.5,9.25,12.5\nc.jpg,,,\n', read_position_csv),
    "opencv.yaml": (
        "%YAML:1.0\n---\nimage_width: 752\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n"
        "   data: [ 458., 0., 367., 0., 457., 248., 0., 0., 1. ]\ndistortion_coefficients: !!opencv-matrix\n"
        "   rows: 4\n   cols: 1\n   dt: d\n   data: [ -0.28, 0.07, 0.0002, 1.8e-05 ]\n",
        read_intrinsics,
    ),
    "opencv.xml": (
        '<?xml version="1.0"?>\n<opencv_storage>\n<camera_matrix type_id="opencv-matrix">\n  <rows>3</rows>\n'
        "  <cols>3</cols>\n  <dt>d</dt>\n  <data>458. 0. 367. 0. 457. 248. 0. 0. 1.</data></camera_matrix>\n"
        "</opencv_storage>\n",
        read_intrinsics,
    ),
    "kalibr.yaml": (
        "cam0:\n  camera_model: pinhole\n  intrinsics: [458.0, 457.0, 367.0, 248.0]\n"
        "  distortion_model: radtan\n  distortion_coeffs: [-0.28, 0.07, 0.0002, 1.8e-05]\n"
        "  resolution: [752, 480]\n",
        read_intrinsics,
    ),
    "model.nvm": (
        "NVM_V3\n\n2\na.jpg 800 1 0 0 0 0 0 0 0.01 0\nb c.jpg 800 1 0 0.1 0 1 0 0 0 0\n\n2\n"
        "0 0 5 255 0 1 2 0 7 2.5 -3 1 8 1 -3\n1 0 6 0 0 0 1 1 9 4 4\n\n0\n#PLY\n0\n",
        sfmcpp.read,
    ),
    "own.g2o": (
        "# g2o\nVERTEX_CAM 3 0.5 0 0 0 0 0 1 500 510 320 240 0.1\n"
        "VERTEX_CAM 4 0 1 0 0 0.1 0 0.99 500 510 320 240 0\n"
        "VERTEX_XYZ 7 0 0 5\nVERTEX_XYZ 1 1 -1 6\nFIX 3 1\nEDGE_PROJECT_P2MC 7 3 270 240 4 1 9\n"
        "EDGE_PROJECT_P2MC 1 3 360.5 155 1 0 1\nEDGE_PROJECT_P2MC 7 4 320 138 1 0 1\n",
        sfmcpp.read,
    ),
    "named.g2o": (
        "PARAMS_CAMERAPARAMETERS 0 500 320 240 0\nVERTEX_SE3:EXPMAP 3 0.5 0 0 0 0 0 1\nFIX 3\n"
        "VERTEX_SE3:EXPMAP 4 0 1 0 0 0.1 0 0.99\nVERTEX_TRACKXYZ 7 0 0 5\nVERTEX_XYZ 1 1 -1 6\n"
        "EDGE_PROJECT_XYZ2UV:EXPMAP 7 3 0 270 240 1 0 1\nEDGE_PROJECT_XYZ2UV:EXPMAP 1 4 0 300.5 99 2 0 2\n",
        sfmcpp.read,
    ),
    "sfm_data.json": (
        '{"sfm_data_version": "0.3", "views": [{"key": 0, "value": {"ptr_wrapper": {"data": {"local_path":\n'
        '"", "filename": "a.jpg", "width": 640, "height": 480, "id_intrinsic": 5, "id_pose": 2}}}}],\n'
        '"intrinsics": [{"key": 5, "value": {"polymorphic_id": 2147483649, "polymorphic_name":\n'
        '"pinhole_radial_k1", "ptr_wrapper": {"data": {"focal_length": 800, "principal_point": [320, 240],\n'
        '"disto_k1": [0.1]}}}}], "extrinsics": [{"key": 2, "value": {"rotation": [[1, 0, 0], [0, 0, 1],\n'
        '[0, -1, 0]], "center": [1, 2, 3]}}], "structure": [{"key": 9, "value": {"X": [1, 2, 3],\n'
        '"observations": [{"key": 0, "value": {"id_feat": 1, "x": [7, 8.5]}}]}}]}\n',
        sfmcpp.read,
    ),
    "cameras.sfm": (
        '{"version": ["1", "2", "6"], "views": [{"viewId": "3", "poseId": "4", "intrinsicId": "5", "path":\n'
        '"a", "width": "640", "height": "480"}], "intrinsics": [{"intrinsicId": "5", "width": "640",\n'
        '"height": "480", "sensorWidth": "36", "type": "radial1", "focalLength": "50", "pixelRatio": "1",\n'
        '"principalPoint": ["1", "-2"], "distortionParams": ["0.1"]}], "poses": [{"poseId": "4", "pose":\n'
        '{"transform": {"rotation": ["1", "0", "0", "0", "0", "1", "0", "-1", "0"], "center":\n'
        '["1", "2", "3"]}}}], "structure": [{"color": ["1", "2", "3"], "X": ["1", "2", "3"],\n'
        '"observations": [{"observationId": "3", "x": ["7", "8.5"]}]}]}\n',
        sfmcpp.read,
    ),
    "transforms.json": (
        '{"camera_model": "OPENCV", "camera_angle_x": 0.8, "w": 640, "h": 480, "k1": 0.1, "frames": [\n'
        '{"file_path": "a.jpg", "transform_matrix": [[1, 0, 0, 1], [0, 0, 1, 2],\n'
        "[0, -1, 0, 3], [0, 0, 0, 1]]},\n"
        '{"file_path": "b.jpg", "fl_x": 700, "fl_y": 701, "cx": 3, "cy": 4,\n'
        '"transform_matrix": [[1, 0, 0, 1], [0, 0, 1, 2], [0, -1, 0, 3], [0, 0, 0, 1]]}]}\n',
        sfmcpp.read,
    ),
}
STRECHA = "2759.5 1.5 1520 \n0 2764 1006 \n0 0 1 \n0 0 0\n0 0 1\n0 1 0\n-1 0 0\n5 -7 0.25\n3072 2048\n"
# What sizes, numbers and indices are hardly ever, in texts and in packed records.
ODD_NUMBERS = (b"nan", b"-inf", b"1e308", b"-1e-320", b"-1", b"0", b"2147483648", b"9223372036854775808")
ODD_WORDS = tuple(
    value.to_bytes(size, "little", signed=value < 0)
    for size in (4, 8)
    for value in (-1, 0, 2**31 - 1, -(2**31), 2**24 + 1)
)
PROBLEMS = ("a.txt", "a.txt.gz", "a.txt.bz2", "a.txt.xz", "a.out", "a.npz", "acams.txt", "model")


def seeds(folder: Path) -> dict[str, tuple[Path, Reader]]:
    """Make a good file for every reader; of several that belong together, the one that is damaged."""
    found: dict[str, tuple[Path, Reader]] = {}
    for name, (text, reader) in TEXTS.items():
        (folder / name).write_text(text)
        found[name] = folder / name, reader
    (folder / "truth").mkdir()
    (folder / "truth" / "a.camera").write_text(STRECHA)
    found["truth/a.camera"] = folder / "truth" / "a.camera", lambda path: sfmcpp.read(path.parent)
    problem = sfmcpp.circle_scene(3, 12, camera_model="bal", seed=0)
    problem.intrinsics[:, 1:] = 0.0
    sfmcpp.write(problem, folder / "text", format="colmap-text")
    for part in ("cameras.txt", "images.txt", "points3D.txt"):
        found[f"text/{part}"] = folder / "text" / part, lambda path: sfmcpp.read(path.parent)
    for name in PROBLEMS:
        sfmcpp.write(problem, folder / name)
        path = folder / name
        if path.is_dir():
            for part in ("cameras.bin", "images.bin", "points3D.bin"):
                found[f"{name}/{part}"] = path / part, lambda path: sfmcpp.read(path.parent)
        else:
            found[name] = path, sfmcpp.read
    some = sfmcpp.read(folder / "text").with_observations(np.arange(problem.num_observations) % 3 > 0)
    sfmcpp.write(some, folder / "some.npz")
    found["converted/some.npz"] = folder / "some.npz", read_and_convert
    found["map/a.npz"] = folder / "a.npz", read_map
    found["map/images.bin"] = folder / "model" / "images.bin", lambda path: read_map(path.parent)
    found["poses/images.bin"] = folder / "model" / "images.bin", lambda path: read_image_poses(path.parent)
    rng = np.random.default_rng(0)
    for name, packed in (("plain.mat", False), ("packed.mat", True)):
        savemat(folder / name, {"a": rng.random((9, 6)), "b": np.ones((2, 2))}, do_compression=packed)
        found[name] = folder / name, lambda path: mat_variables(path, ["a", "b"])
    pixels = Image.fromarray(rng.integers(0, 255, (24, 32), np.uint8))
    for suffix in ("png", "jpg", "tif"):
        content = BytesIO()
        pixels.save(content, {"png": "PNG", "jpg": "JPEG", "tif": "TIFF"}[suffix])
        for kind, reader in (("frames", open_first_frame), ("photos", lambda path: open_photos(path.parent))):
            place = folder / f"{kind}_{suffix}"
            place.mkdir()
            (place / f"a.{suffix}").write_bytes(content.getvalue())
            found[f"{kind}/a.{suffix}"] = place / f"a.{suffix}", reader
    return found | bags(folder)


def bags(folder: Path) -> dict[str, tuple[Path, Reader]]:
    """Small bags, written as the tests of their reader write them."""
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests/python/e2e"))
    from bag_writing import KINDS, START_NS, messages_for, write_bag

    found: dict[str, tuple[Path, Reader]] = {}
    for kind in KINDS:
        made = messages_for(kind)
        recorded = [("/tf_static", made.transforms(("body", "cam", (1, 0, 0, 0), (1, 0, 0))))]
        for time_ns in range(START_NS, START_NS + 3_000_000, 1_000_000):
            recorded += [
                ("/c/image", made.image(time_ns, np.zeros((6, 8)))),
                ("/c/camera_info", made.camera_info(time_ns, np.diag([9, 9, 1]))),
                ("/odom", made.odometry(time_ns, (1, 0, 0), "body")),
                ("/imu", made.imu(time_ns, (0, 0, 1), "body")),
                ("/fix", made.fix(time_ns, (48, 11, 500), 0.5)),
            ]
        path = write_bag(folder / f"bag.{kind}", made, recorded)
        file = path if path.is_file() else next(f for f in path.iterdir() if f.suffix == path.suffix)
        found[path.name] = file, unpack
    return found


def unpack(path: Path) -> object:
    """Unpack a bag into a folder that does not stay."""
    with tempfile.TemporaryDirectory() as folder:
        return unpack_bag(path, Path(folder) / "out")


def read_and_convert(path: Path) -> object:
    """Read an archive whose checksums nobody compares, and write it in other forms that read as well."""
    with mock.patch.object(zipfile.ZipExtFile, "_update_crc"):
        problem = sfmcpp.read(path)
    for name in ("colmap-text", "colmap-binary", "npz"):
        target = path.parent / f"converted-{name}"
        sfmcpp.write(problem, target, format=name)
        sfmcpp.read(target, format=name)
    return problem


def open_first_frame(path: Path) -> object:
    """Decode the first frame of a folder."""
    return next(iter(open_frames(path.parent)))


def damaged(data: bytes, seed: tuple[int, ...]) -> bytes:
    """Change a few places of some bytes."""
    rng = np.random.default_rng(seed)
    result = bytearray(data)
    for _ in range(rng.integers(1, 5)):
        at = int(rng.integers(0, len(result) + 1))
        length = int(2 ** rng.uniform(0, 5))
        kind = rng.integers(0, 8)
        if kind <= 1 and at < len(result):
            result[at] = int(rng.integers(0, 256)) if kind else result[at] ^ (1 << int(rng.integers(0, 8)))
        elif kind == 2:
            del result[at : at + length]
        elif kind == 3:
            result[at:at] = result[at : at + length]
        elif kind == 4:
            numbers = list(re.finditer(rb"[-+]?\d+\.?\d*(?:e[-+]?\d+)?", bytes(result)))
            if numbers:
                begin, end = numbers[rng.integers(len(numbers))].span()
                result[begin:end] = ODD_NUMBERS[rng.integers(len(ODD_NUMBERS))]
        elif kind == 5:
            word = ODD_WORDS[rng.integers(len(ODD_WORDS))]
            result[at : at + len(word)] = word
        elif kind == 6:
            source = int(rng.integers(0, len(result) + 1))
            result[at:at] = result[source : source + 4 * length]
        elif rng.random() < 0.2:
            del result[at:]
    return bytes(result)


def outcome(path: Path, reader: Reader) -> str:
    """Read one file."""
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    signal.alarm(SECONDS_BY_THE_CLOCK)
    try:
        reader(path)
    except SfmcppError:
        return "refused"
    except Exception as error:
        return f"raw exception {type(error).__name__}: {error}".replace("\n", " ")
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.alarm(0)
    return "read"


def in_a_child(path: Path, reader: Reader, data: bytes, numbers: range, seed: int) -> list[str]:
    """Outcomes of some files; the last is how the process ended, if it did not live to tell of all."""
    incoming, outgoing = os.pipe()
    child = os.fork()
    if child == 0:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
        for number in numbers:
            path.write_bytes(damaged(data, (seed, number)))
            os.write(outgoing, f"{outcome(path, reader)}\n".encode("utf-8", "replace"))
        os._exit(0)
    os.close(outgoing)
    with os.fdopen(incoming, errors="replace") as pipe:
        told = pipe.read().splitlines()
    status = os.waitpid(child, 0)[1]
    if len(told) < len(numbers):
        ended = os.WTERMSIG(status)
        told.append("too slow" if ended in (signal.SIGALRM, signal.SIGPROF) else f"killed by signal {ended}")
    return told


def tried(name: str, path: Path, reader: Reader, numbers: range, seed: int) -> Counter[str]:
    """Outcomes of some files of a reader, counted; faults are printed."""
    data, totals, number = path.read_bytes(), Counter[str](), numbers.start
    while number < numbers.stop:
        for told in in_a_child(path, reader, data, range(number, numbers.stop), seed):
            kind = next(known for known in OUTCOMES if told.startswith(known))
            totals[kind] += 1
            if kind in FAULTS:
                print(f"{name}, file ({seed}, {number}): {told}", flush=True)
            number += 1
    path.write_bytes(data)
    return totals


class Progress:
    """Says every few seconds how far a run is."""

    def __init__(self, inputs: int) -> None:
        self._inputs = inputs
        self._begin = self._said = time.monotonic()

    def say(self, totals: Counter[str], now: str) -> None:
        """One line, if the last is old enough."""
        if time.monotonic() - self._said < SECONDS_BETWEEN_LINES:
            return
        self._said = time.monotonic()
        rate = totals.total() / (self._said - self._begin)
        faults = sum(totals[kind] for kind in FAULTS)
        line = f"{totals.total():,} of {self._inputs:,}, {rate:,.0f} a second, {faults} faults; at {now}"
        print(line, file=sys.stderr, flush=True)


def print_table(totals: dict[str, Counter[str]]) -> None:
    """What became of the files of every reader."""
    everything = sum(totals.values(), Counter[str]())
    print("".join(f"{cell:<18}" for cell in ("file", *OUTCOMES)).rstrip())
    for name, counts in [*totals.items(), ("all", everything)]:
        print("".join(f"{cell:<18}" for cell in (name, *(counts[kind] for kind in OUTCOMES))).rstrip())


def main(inputs: int, seed: int, first: int, names: list[str]) -> int:
    """Print the table; 1 if there is a fault, 130 if it was stopped."""
    with tempfile.TemporaryDirectory() as folder:
        chosen = {name: made for name, made in seeds(Path(folder)).items() if name in names or not names}
        totals = {name: Counter[str]() for name in chosen}
        progress, begin, end = Progress(inputs), first, first + -(-inputs // len(chosen))
        try:
            for begin in range(first, end, BATCH):
                for name, (path, reader) in chosen.items():
                    totals[name] += tried(name, path, reader, range(begin, min(begin + BATCH, end)), seed)
                    progress.say(sum(totals.values(), Counter()), name)
        except KeyboardInterrupt:
            print_table(totals)
            print(f"stopped: go on with --seed {seed} --first {begin}")
            return 130
    print_table(totals)
    return int(any(counts[kind] for counts in totals.values() for kind in FAULTS))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("names", nargs="*")
    parser.add_argument("--inputs", type=int, default=30_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0, help="number of the first file of every reader")
    given = parser.parse_args()
    sys.exit(main(given.inputs, given.seed, given.first, given.names))
