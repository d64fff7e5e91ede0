"""`sfmcpp` on rigs: solved, written and told, or let go of."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import sfmcpp
from cli_helpers import run_here


@pytest.fixture
def start(tmp_path: Path) -> Path:
    """A COLMAP model of a rig away from its optimum."""
    truth = sfmcpp.rig_walk_scene(12, 400, length_m=3, camera_model="perspective", seed=0)
    moved = sfmcpp.perturb(truth, point_sigma_m=0.02, position_sigma_m=0.02, seed=1)
    sfmcpp.write(moved, tmp_path / "start")
    return tmp_path / "start"


def test_a_rig_is_solved_and_written_as_one(start: Path, tmp_path: Path) -> None:
    done = run_here("solve", start, "-o", tmp_path / "solved")
    assert done.returncode == 0, done.stderr
    assert "solved as rigs: one pose for each of 4 frames, sensors fixed" in done.stdout
    solved, before = sfmcpp.read(tmp_path / "solved"), sfmcpp.read(start)
    assert solved.rigs is not None
    assert before.rigs is not None
    np.testing.assert_allclose(solved.rigs.sensors, before.rigs.sensors, rtol=0, atol=1e-12)
    assert sfmcpp.cost(solved) < 0.1 * sfmcpp.cost(before)


def test_a_solve_of_a_rig_may_be_repeated_and_not_replaced_by_cameras_alone(
    start: Path, tmp_path: Path
) -> None:
    for _ in range(2):
        assert run_here("solve", start, "-o", tmp_path / "solved").returncode == 0
    refused = run_here("solve", start, "-o", tmp_path / "solved", "--rigs", "ignore")
    told = "would contradict the new poses" in refused.stderr
    assert (refused.returncode, told) == (2, True)
    assert "iterations" not in refused.stdout


def test_sensors_of_a_rig_are_found_and_written(start: Path, tmp_path: Path) -> None:
    problem = sfmcpp.read(start)
    assert problem.rigs is not None
    frames, true = problem.rigs.frames(problem.cameras), problem.rigs.sensors.copy()
    problem.rigs.sensors[1, :, 3] += 0.05
    problem.cameras[:] = problem.rigs.cameras(frames)
    sfmcpp.write(problem, tmp_path / "away")
    done = run_here("solve", tmp_path / "away", "-o", tmp_path / "found", "--rigs", "free")
    assert done.returncode == 0, done.stderr
    assert "solved as rigs: one pose for each of 4 frames, 2 of 3 sensors free" in done.stdout
    found = sfmcpp.read(tmp_path / "found")
    assert found.rigs is not None
    np.testing.assert_array_equal(found.rigs.sensors[0], np.eye(3, 4))
    ways = [np.linalg.norm(p.centres[-3] - p.centres[0]) for p in (problem, found)]
    off = np.linalg.norm(found.rigs.sensors[1, :, 3] * (ways[0] / ways[1]) - true[1, :, 3])
    assert off < 0.25 * np.linalg.norm([0.05, 0.05, 0.05])
    np.testing.assert_allclose(found.cameras, found.rigs.rigid(found.cameras), atol=1e-9)


def test_sensors_are_not_asked_for_where_there_are_no_rigs(start: Path, tmp_path: Path) -> None:
    alone = sfmcpp.read(start)
    alone.rigs = None
    sfmcpp.write(alone, tmp_path / "alone.npz")
    refused = run_here("solve", tmp_path / "alone.npz", "--rigs", "free")
    told = "alone.npz: no rigs, so there are no sensors for --rigs free" in refused.stderr
    assert (refused.returncode, told) == (2, True)


def test_a_rig_can_be_let_go_of(start: Path, tmp_path: Path) -> None:
    done = run_here("solve", start, "-o", tmp_path / "alone", "--rigs", "ignore")
    assert done.returncode == 0, done.stderr
    assert "rigs" not in done.stdout.replace("--rigs", "")
    assert sfmcpp.read(tmp_path / "alone").rigs is None


def test_positions_bring_a_rig_to_their_scale(start: Path, tmp_path: Path) -> None:
    # Measured in centimetres: the rig grows with its world.
    before = sfmcpp.read(start)
    rows = [f"{k},{x},{y},{z}" for k, (x, y, z) in enumerate((100 * before.centres).tolist())]
    (tmp_path / "gps.csv").write_text("index,x,y,z\n" + "\n".join(rows) + "\n")
    done = run_here("solve", start, "-o", tmp_path / "placed", "--gps", tmp_path / "gps.csv")
    assert done.returncode == 0, done.stderr
    placed = sfmcpp.read(tmp_path / "placed")
    assert placed.rigs is not None
    assert before.rigs is not None
    sizes = [np.linalg.norm(np.diff(p.rigs.sensors[:2, :, 3], axis=0)) for p in (placed, before) if p.rigs]
    assert sizes[0] / sizes[1] == pytest.approx(100, rel=0.05)
