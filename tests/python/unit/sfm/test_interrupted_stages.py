"""Ctrl-C in the last stages of a reconstruction, or useless positions, keep the models that there are."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import sfmcpp.sfm.run as sfm_run
from flights import flight
from sfm_scenes import match_graph
from sfmcpp.geometry import reprojection_errors_px
from sfmcpp.map import Map
from sfmcpp.model.metadata import WorldOrigin
from sfmcpp.sfm import MatchGraph, reconstruct
from sfmcpp.sfm.result import SfmRun
from sfmcpp.sfm.settings import IncrementalSettings

OUTLIER_PX = IncrementalSettings().outlier_px
PLACES = np.array([[12.0 * step, 15.0 * row] for row in (0, 1) for step in range(4)])
TRUTH = flight(PLACES, seed=5)


@pytest.fixture(scope="module")
def graph() -> MatchGraph:
    return match_graph(TRUTH, sigma_px=0.3, reach=2)


@pytest.fixture
def table(graph: MatchGraph, tmp_path: Path) -> Path:
    return table_of(graph, tmp_path / "gps.csv", range(TRUTH.num_cameras))


def table_of(graph: MatchGraph, path: Path, images: Iterable[int]) -> Path:
    rows = ((graph.photos[image].name, TRUTH.centres[image].tolist()) for image in images)
    path.write_text("\n".join(["name,x,y,z", *(f"{name},{x},{y},{z}" for name, (x, y, z) in rows)]))
    return path


def run_of(graph: MatchGraph, gps: Path | str) -> SfmRun:
    return reconstruct(graph, camera=500.0, subpixel=False, gps=gps)


def assert_same_model(found: SfmRun, expected: SfmRun) -> None:
    assert found.model is not None
    assert expected.model is not None
    for name in ("poses", "points", "intrinsics", "fixed_intrinsics"):
        assert np.array_equal(getattr(found.model, name), getattr(expected.model, name), equal_nan=True), name
    assert (found.model.origin is None) == (expected.model.origin is None)


def changed_and_stopped(world: Map, *_: object) -> None:
    """A stage that Ctrl-C ends when it has changed the model."""
    world.poses[:, :, 3] += 7.0
    world.intrinsics[:, 0] *= 2.0
    world.fixed_intrinsics[:] = True
    world.origin = WorldOrigin(np.ones(3), geodetic=False)
    raise KeyboardInterrupt


def stopped(*_: object) -> None:
    raise KeyboardInterrupt


def test_ctrl_c_while_focal_lengths_are_judged(graph: MatchGraph, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sfm_run, "settle_focals_by_images", lambda *_: [])
    expected = run_of(graph, "none")
    monkeypatch.setattr(sfm_run, "settle_focals_by_images", changed_and_stopped)
    found = run_of(graph, "none")
    assert found.interrupted
    assert found.warnings[-1] == "interrupted while focal lengths were judged: they are as they were before"
    assert_same_model(found, expected)


def test_ctrl_c_while_a_model_is_georeferenced(
    graph: MatchGraph, table: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sfm_run, "settle_focals_by_images", lambda *_: [])
    expected = run_of(graph, "none")
    monkeypatch.setattr(sfm_run, "georeference_map", changed_and_stopped)
    found = run_of(graph, table)
    assert found.interrupted
    assert found.gps is None
    assert "interrupted while the model was georeferenced" in found.warnings[-1]
    assert_same_model(found, expected)


def test_too_few_positions_in_the_model_cost_no_model(graph: MatchGraph, tmp_path: Path) -> None:
    alone = replace(graph, pairs=[pair for pair in graph.pairs if pair.second != 7])
    found = run_of(alone, table_of(graph, tmp_path / "gps.csv", (0, 1, 2, 4, 7)))
    why = "gps: 4 images of the model have a position, 5 are needed"
    assert found.gps is None
    assert found.gps_failure == why
    assert f"positions that were given are not used: {why}" in found.warnings
    assert_same_model(found, run_of(alone, "none"))


def test_a_georeferenced_model_stays_so(
    graph: MatchGraph, table: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    expected = run_of(graph, table)
    assert expected.gps is not None
    assert not expected.interrupted
    monkeypatch.setattr(sfm_run, "_settle_focals", stopped)
    found = run_of(graph, table)
    assert found.interrupted
    assert found.gps is not None
    assert_same_model(found, expected)


@pytest.mark.parametrize("at", [1, 12, 28, 60])
def test_a_stop_is_heeded_within_adjustments(graph: MatchGraph, at: int) -> None:
    told: list[tuple[str, int]] = []

    def progress(stage: str, done: int, total: int) -> bool:
        told.append((stage, done))
        return len(told) >= at

    found = reconstruct(graph, camera=500.0, subpixel=False, progress=progress)
    assert found.interrupted
    assert len(told) == at
    assert at == 1 or told[-1] == told[-2]  # not only when an image has been taken in
    assert (found.model is None) == (told[-1][1] == 0)
    if found.model is not None:
        local = found.model.whole_problem(2)
        assert local.problem.num_points > 50
        assert reprojection_errors_px(local.problem, local.problem.points).max() <= OUTLIER_PX
