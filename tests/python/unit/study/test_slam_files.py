"""The COLMAP model of a SLAM run has the sizes, names and pixels of its images as COLMAP has them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import sfmcpp
from sfmcpp.model.frames import Frame, View
from sfmcpp.slam import SlamResult, SlamRun, SlamSettings, TrackSequence, WorldMap
from sfmcpp.sources.drives import Drive
from sfmcpp.study.slam_files import colmap_problem

CAMERA = np.array([500.0, 1.0, 320.0, 240.0, 0.0])
PIXELS = np.array([[0.0, 0.0], [319.25, 101.5], [600.0, 420.0]])
NUMBERS = (0, 2, 3)


class Images(TrackSequence):
    """Tracks that were followed in images."""

    def __init__(self, names: tuple[str, ...]) -> None:
        super().__init__(np.arange(4.0), [0, 1], [0, 3], np.zeros((2, 2)), CAMERA)
        self.image_size, self.image_names, self.first_pixel_px = (641, 480), names, 0.0


def run_of(frames: TrackSequence) -> SlamRun:
    world = WorldMap(CAMERA)
    for number in NUMBERS:
        world.add(Frame(number, 0.1 * number, View(np.arange(3, dtype=np.int32), PIXELS)), np.eye(3, 4))
    world.points[:3] = 2.0 * np.column_stack([(PIXELS - CAMERA[2:4]) / CAMERA[0], np.ones(3)])
    result = SlamResult()
    result.path.world = world
    return SlamRun(Drive(Path("drive"), frames), SlamSettings(), (), result, 4, 2.0, False)


def written(run: SlamRun, folder: Path) -> sfmcpp.Problem:
    assert run.world is not None
    problem = run.world.whole_problem(min_views=2).problem
    before = problem.copy()
    sfmcpp.write(colmap_problem(problem, run), folder, format="colmap-binary")
    np.testing.assert_array_equal(problem.pixels, before.pixels)
    np.testing.assert_array_equal(problem.intrinsics, before.intrinsics)
    return sfmcpp.read(folder)


def test_pixels_of_images_count_from_the_corner(tmp_path: Path) -> None:
    found = written(run_of(Images(("a.png", "b.png", "c.png", "d.png"))), tmp_path / "model")
    assert found.metadata.image_sizes is not None
    assert found.metadata.image_sizes.tolist() == [[641, 480]] * 3
    assert found.metadata.image_names == ["a.png", "c.png", "d.png"]
    np.testing.assert_array_equal(found.pixels, np.repeat(PIXELS + 0.5, 3, axis=0))
    np.testing.assert_array_equal(found.intrinsics[0, :4], [500, 1, 320.5, 240.5])
    assert sfmcpp.cost(found) == pytest.approx(0, abs=1e-18)


def test_a_name_that_no_list_of_images_holds_leaves_numbers(tmp_path: Path) -> None:
    found = written(run_of(Images(("a.png", "b.png", "c.png", "d\n.png"))), tmp_path / "model")
    assert found.metadata.image_names == [f"frame_{number:06d}" for number in NUMBERS]


def test_pixels_of_tracks_stay_as_they_are(tmp_path: Path) -> None:
    tracks = TrackSequence(np.arange(4.0), [0, 1], [0, 3], np.zeros((2, 2)), CAMERA)
    found = written(run_of(tracks), tmp_path / "model")
    np.testing.assert_array_equal(found.pixels, np.repeat(PIXELS, 3, axis=0))
    np.testing.assert_array_equal(found.intrinsics[0, 2:4], CAMERA[2:4])
