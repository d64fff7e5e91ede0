"""Positions of images: the model in their world, and those that lie."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

import sfmcpp
from sfm_scenes import match_graph
from sfmcpp.errors import InvalidArgument
from sfmcpp.map import Map
from sfmcpp.model import Problem
from sfmcpp.sensors.gps import east_north_up
from sfmcpp.sfm.cameras import cameras_of
from sfmcpp.sfm.georeference import Positions, georeference, positions_of
from sfmcpp.sfm.incremental import grow_models
from sfmcpp.sfm.scene import Scene
from sfmcpp.sfm.settings import IncrementalSettings

SETTINGS = IncrementalSettings()
NOWHERE = np.full(3, np.nan)


@lru_cache
def truth_of(seed: int) -> Problem:
    return sfmcpp.circle_scene(20, 250, pixel_sigma_px=0.0, radius_m=60.0, cube_m=30.0, seed=seed)


def model_of(seed: int) -> Map:
    """A model of ``truth_of(seed)``, that a test may change."""
    return deepcopy(_grown(seed))


@lru_cache
def _grown(seed: int) -> Map:
    truth = truth_of(seed)
    graph = match_graph(truth, sigma_px=0.5, seed=seed)
    cameras = cameras_of(graph.photos, calibration=np.append(truth.intrinsics[0, :5], np.zeros(7)))
    return grow_models(Scene.of(graph, cameras), SETTINGS, lambda _: False).models[0]


def error_m(world: Map, truth: Problem) -> float:
    return float(np.sqrt(((world.poses[:, :, 3] - truth.centres) ** 2).sum(axis=1).mean()))


@pytest.mark.parametrize("seed", range(3))
def test_positions_that_lie_are_named_and_cost_nothing(seed: int) -> None:
    truth = truth_of(seed)
    random = np.random.default_rng(seed)
    honest = truth.centres + random.normal(0, 1.0, truth.centres.shape)
    liars = np.sort(random.choice(truth.num_cameras, 3, replace=False))
    lies = honest.copy()
    directions = random.normal(size=(3, 3))
    lies[liars] += 20 * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    by_hand = honest.copy()
    by_hand[liars] = np.nan
    world, control = model_of(seed), model_of(seed)
    found = georeference(world, Positions(lies, NOWHERE), SETTINGS)
    georeference(control, Positions(by_hand, NOWHERE), SETTINGS)
    assert found.outliers == [world.image_names[liar] for liar in liars]
    assert error_m(world, truth) <= 1.05 * error_m(control, truth)
    assert found.sigma_m == pytest.approx(1.0, rel=0.35)  # of 51 numbers: 10 % is one standard deviation


def test_the_stated_accuracy_is_that_of_the_model_in_the_world() -> None:
    stated, true = [], []
    for seed in range(4):
        truth = truth_of(seed)
        gps = truth.centres + np.random.default_rng(seed + 9).normal(0, 0.5, truth.centres.shape)
        world = model_of(seed)
        stated.append(georeference(world, Positions(gps, NOWHERE), SETTINGS).accuracy_m ** 2)
        true.append(error_m(world, truth) ** 2 / 3)
    assert (
        0.4 < np.mean(true) / np.mean(stated) < 2.5
    )  # 28 numbers: a factor of 1.3 is one standard deviation


def test_geodetic_positions_are_metres_east_north_up_of_their_mean() -> None:
    known = {"a": (46.0, 9.0, 100.0), "b": (46.001, 9.0, 100.0), "unknown": (0.0, 0.0, 0.0)}
    found = positions_of(["a", "b", "c"], known, geodetic=True)
    assert np.isnan(found.metres[2]).all()
    # A thousandth of a degree of latitude is 111.15 m there.
    assert found.metres[1] - found.metres[0] == pytest.approx([0.0, 111.15, 0.0], abs=0.05)
    assert found.origin == pytest.approx([46.0005, 9.0, 100.0])
    assert east_north_up(found.origin[None], found.origin) == pytest.approx(np.zeros((1, 3)))


def test_too_few_positions_and_those_on_a_line_are_refused() -> None:
    truth = truth_of(0)
    world = model_of(0)
    few = np.full(truth.centres.shape, np.nan)
    few[:4] = truth.centres[:4]
    with pytest.raises(InvalidArgument, match=r"4 images of the model have a position, 5 are needed"):
        georeference(world, Positions(few, NOWHERE), SETTINGS)
    line = np.outer(np.arange(len(few)), [1.0, 2.0, 0.0])
    with pytest.raises(InvalidArgument, match=r"lie on a line"):
        georeference(world, Positions(line, NOWHERE), SETTINGS)
    with pytest.raises(InvalidArgument, match=r"none of its names \(x\) is the name of an image"):
        positions_of(["a"], {"x": (0.0, 0.0, 0.0)}, geodetic=False)


def test_the_same_bits_for_the_same_seed() -> None:
    truth = truth_of(1)
    gps = truth.centres + np.random.default_rng(0).normal(0, 1, truth.centres.shape)
    a, b = model_of(1), model_of(1)
    one = georeference(a, Positions(gps, NOWHERE), replace(SETTINGS, seed=3))
    two = georeference(b, Positions(gps, NOWHERE), replace(SETTINGS, seed=3))
    assert np.array_equal(a.poses, b.poses)
    assert one.sigma_m == two.sigma_m
