"""What is no field of a problem, of its parts or of a group of constraints cannot be set on it."""

from __future__ import annotations

import pickle
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest

import sfmcpp


def positions(**weights: float) -> sfmcpp.ConstraintGroup:
    return sfmcpp.ConstraintGroup("position", [0, 1], np.zeros((2, 3)), **weights)


def test_a_misspelt_field_of_a_problem_is_refused_with_the_one_that_was_meant() -> None:
    problem = sfmcpp.circle_scene(4, 20, seed=0)
    with pytest.raises(
        AttributeError, match="Problem has no field 'fixed_camera'; did you mean 'fixed_cameras'"
    ):
        problem.fixed_camera = np.ones(4, bool)  # type: ignore[attr-defined]
    with pytest.raises(AttributeError, match="Metadata has no field 'names'; did you mean 'image_names'"):
        problem.metadata.names = ["a"]  # type: ignore[attr-defined]
    with pytest.raises(AttributeError, match=r"'centres'.*has no setter|can't set"):
        problem.centres = problem.centres  # type: ignore[misc]


def test_a_misspelt_field_of_rigs_is_refused() -> None:
    rigs = sfmcpp.Rigs(np.eye(3, 4)[None], [0, 1], [0, 0])
    with pytest.raises(AttributeError, match="Rigs has no field 'free_sensor'; did you mean 'free_sensors'"):
        rigs.free_sensor = [True]  # type: ignore[attr-defined]


def test_a_name_unlike_all_fields_is_refused_with_all() -> None:
    with pytest.raises(
        AttributeError, match="has no field 'q': must be one of kind, cameras, values, weight,"
    ):
        positions().q = 1  # type: ignore[attr-defined]


def test_no_field_can_be_deleted() -> None:
    problem, group = sfmcpp.circle_scene(4, 20, seed=0), positions()
    with pytest.raises(AttributeError, match="Problem: the field 'sigma_px' cannot be deleted"):
        del problem.sigma_px
    with pytest.raises(AttributeError, match="ConstraintGroup: the field 'weight' cannot be deleted"):
        del group.weight
    assert (problem.sigma_px, group.weight) == (None, 1.0)


def test_a_standard_deviation_set_later_is_refused_as_it_would_have_no_effect() -> None:
    group = positions(sigma=0.1)
    rule = r"constraints\['position'\].sigma: is not stored.*make a new group"
    with pytest.raises(AttributeError, match=rule):
        group.sigma = 0.2
    assert group.weight == pytest.approx(3 / 0.1**2)


def test_fields_can_be_set_replaced_copied_and_pickled() -> None:
    group = positions(sigma=0.1)
    group.weight = 5.0
    assert replace(group, name="gps").weight == 5.0
    assert pickle.loads(pickle.dumps(group)).weight == deepcopy(group).weight == 5.0


@pytest.mark.parametrize(
    ("given", "meant"),
    [
        ({"constraint": []}, "'constraint'; did you mean 'constraints'"),
        ({"num_threads": 2}, "'num_threads'; did you mean 'threads'"),
        ({"max_num_iterations": 2}, "'max_num_iterations'; did you mean 'max_iterations'"),
        ({"verbose": True}, "'verbose': must be one of problem, constraints, weight, callback,"),
    ],
)
def test_a_misspelt_argument_of_a_solve_is_refused_with_the_one_that_was_meant(
    given: dict[str, object], meant: str
) -> None:
    with pytest.raises(TypeError, match=meant):
        sfmcpp.solve(sfmcpp.circle_scene(4, 20, seed=0), **given)  # type: ignore[arg-type]


def test_an_async_callback_is_refused() -> None:
    async def stop(iteration: sfmcpp.Iteration) -> bool:
        return False

    with pytest.raises(sfmcpp.InvalidArgument, match=r"callback = .*stop.*must not be async"):
        sfmcpp.solve(sfmcpp.circle_scene(4, 20, seed=0), callback=stop)
