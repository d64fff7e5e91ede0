"""Problems, constraints and maps in any order of calls: what is refused changes nothing, the rest fits.

`SFMCPP_STATEFUL_EXAMPLES` is how many sequences of calls are tried; the default takes seconds.
"""

from __future__ import annotations

import os
from dataclasses import fields
from typing import Any

import numpy as np
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

import sfmcpp
from sfmcpp import ConstraintGroup, InvalidArgument, Problem
from sfmcpp.geometry import Similarity
from sfmcpp.map import Map

EXAMPLES = int(os.environ.get("SFMCPP_STATEFUL_EXAMPLES", "12"))
SETTINGS = settings(
    max_examples=EXAMPLES, stateful_step_count=12, deadline=None, derandomize=True, database=None
)
NUMBERS = st.integers(-2, 40)
ROWS = st.lists(NUMBERS, max_size=6)
ODD = st.sampled_from([None, 3, "odd", [], [[1.0], [1.0, 2.0]], np.nan, np.zeros((2, 3)), np.ones(7), -1])
ARRAYS = st.sampled_from([f.name for f in fields(Problem) if f.name not in ("camera_model", "metadata")])


def arrays_of(record: Any) -> dict[str, Any]:
    """Copies of all arrays of a problem or a group."""
    return {
        f.name: np.array(getattr(record, f.name), copy=True)
        for f in fields(record)
        if is_array(record, f.name)
    }


def is_array(record: Any, name: str) -> bool:
    return isinstance(getattr(record, name), np.ndarray)


def assert_same(before: dict[str, Any], after: dict[str, Any]) -> None:
    assert before.keys() == after.keys()
    for name, value in before.items():
        np.testing.assert_array_equal(value, after[name], err_msg=name)


class Problems(RuleBasedStateMachine):
    """A problem whose fields are set to anything, with a group of constraints."""

    @initialize(model=st.sampled_from(["calibrated", "perspective", "bal"]), seed=st.integers(0, 3))
    def start(self, model: str, seed: int) -> None:
        scene = sfmcpp.circle_scene(4, 12, camera_model=model, seed=seed)
        self.problem = sfmcpp.perturb(scene, point_sigma_m=0.1, seed=seed)
        self.group = ConstraintGroup("position", [0, 1], scene.centres[:2].copy())

    def tried(self, call: Any) -> None:
        """A call that works, or is refused by name and has changed nothing."""
        before, members = arrays_of(self.problem), arrays_of(self.group)
        try:
            call()
        except InvalidArgument:
            assert_same(before, arrays_of(self.problem))
            assert_same(members, arrays_of(self.group))

    @rule()
    def solve(self) -> None:
        self.tried(lambda: sfmcpp.solve(self.problem, max_iterations=2, threads=1))

    @rule()
    def solve_with_constraints(self) -> None:
        self.tried(lambda: sfmcpp.solve(self.problem, constraints=[self.group], max_iterations=2, threads=1))

    @rule(name=ARRAYS, value=ODD)
    def a_field_is_spoilt_for_one_solve(self, name: str, value: Any) -> None:
        sound = getattr(self.problem, name)
        setattr(self.problem, name, value)
        self.tried(lambda: sfmcpp.solve(self.problem, max_iterations=1, threads=1))
        setattr(self.problem, name, sound)

    @rule(name=st.sampled_from(["values", "cameras", "member_weights", "weight", "loss"]), value=ODD)
    def a_group_is_spoilt_for_one_solve(self, name: str, value: Any) -> None:
        sound = getattr(self.group, name)
        before = arrays_of(self.problem)
        setattr(self.group, name, value)
        try:
            sfmcpp.solve(self.problem, constraints=[self.group], max_iterations=1, threads=1)
        except InvalidArgument:
            assert_same(before, arrays_of(self.problem))
        setattr(self.group, name, sound)

    @rule(rows=ROWS)
    def some_observations(self, rows: list[int]) -> None:
        def keep() -> None:
            chosen = self.problem.with_observations(rows)
            assert chosen.num_observations == len(rows)

        self.tried(keep)

    @rule(share=st.floats(0.5, 1.0))
    def fewer_observations(self, share: float) -> None:
        self.problem = self.problem.with_observations(np.arange(int(share * self.problem.num_observations)))

    @rule(camera=NUMBERS, fixed=st.booleans())
    def fix(self, camera: int, fixed: bool) -> None:
        self.problem.fixed_cameras[camera % self.problem.num_cameras] = fixed

    @rule()
    def copy(self) -> None:
        copied = self.problem.copy()
        before = arrays_of(self.problem)
        copied.points[:] += 1.0
        copied.cameras[:, :, 3] += 1.0
        assert_same(before, arrays_of(self.problem))

    @invariant()
    def all_fits_together(self) -> None:
        problem = self.problem
        assert problem.num_observations == len(problem.point_index) == len(problem.pixels)
        assert np.isfinite(problem.cameras).all()
        assert np.isfinite(problem.points).all()
        if problem.num_observations:
            assert 0 <= problem.camera_index.min() <= problem.camera_index.max() < problem.num_cameras
            assert 0 <= problem.point_index.min() <= problem.point_index.max() < problem.num_points


class Maps(RuleBasedStateMachine):
    """A map of which anything is asked, with numbers that need not exist."""

    @initialize(seed=st.integers(0, 3))
    def start(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        self.world = Map("calibrated")
        self.world.add_cameras([[500.0, 1.0, 320.0, 240.0, 0.0]])
        self.add_points()
        self.add_image()

    def state(self) -> dict[str, Any]:
        world = self.world
        names = ("poses", "points", "keypoints", "keypoint_points", "keypoint_images", "intrinsics")
        return {name: np.array(getattr(world, name), copy=True) for name in names}

    def tried(self, call: Any) -> None:
        before = self.state()
        try:
            call()
        except InvalidArgument:
            assert_same(before, self.state())

    @rule()
    def add_points(self) -> None:
        self.world.add_points(self.rng.normal(8.0, 1.0, size=(6, 3)))

    @rule()
    def add_image(self) -> None:
        pose = np.hstack([np.eye(3), self.rng.normal(size=(3, 1))])
        self.world.add_images(["a"], [0], [5], self.rng.uniform(0, 400, (5, 2)), poses=[pose])

    @rule(rows=ROWS, points=ROWS)
    def observe(self, rows: list[int], points: list[int]) -> None:
        self.tried(lambda: self.world.observe(rows, points))

    @rule(rows=ROWS)
    def forget(self, rows: list[int]) -> None:
        self.tried(lambda: self.world.forget(rows))

    @rule(points=ROWS)
    def remove(self, points: list[int]) -> None:
        self.tried(lambda: self.world.remove_points(points))

    @rule(kept=NUMBERS, gone=NUMBERS)
    def merge(self, kept: int, gone: int) -> None:
        self.tried(lambda: self.world.merge(kept, gone))

    @rule(scale=st.floats(0.5, 2.0))
    def transform(self, scale: float) -> None:
        self.world.transform(Similarity(scale, np.eye(3), np.ones(3)))

    @rule()
    def join_itself(self) -> None:
        if self.world.num_images > 8:
            return
        other = Map("calibrated")
        other.join(self.world)
        before, points = self.state(), len(self.world.points)
        self.world.join(other)
        after = self.state()
        assert_same(before, {name: after[name][: len(value)] for name, value in before.items()})
        assert len(self.world.points) == 2 * points

    @rule(images=ROWS)
    def adjust(self, images: list[int]) -> None:
        def adjusted() -> None:
            local = self.world.local_problem(images)
            sfmcpp.solve(local.problem, max_iterations=2, threads=1)
            self.world.take(local)

        self.tried(adjusted)

    @invariant()
    def tracks_are_consistent(self) -> None:
        world = self.world
        seen = world.keypoint_points
        assert len(seen) == len(world.keypoints) == len(world.keypoint_images)
        assert ((seen >= -1) & (seen < len(world.points))).all()
        linked = np.flatnonzero(seen >= 0)
        pairs = np.column_stack([world.keypoint_images[linked], seen[linked]])
        assert len(np.unique(pairs, axis=0)) == len(pairs)
        np.testing.assert_array_equal(np.sort(world.observations_of(np.arange(len(world.points)))), linked)


TestProblems = Problems.TestCase
TestProblems.settings = SETTINGS
TestMaps = Maps.TestCase
TestMaps.settings = SETTINGS
