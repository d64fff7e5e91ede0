"""A problem is shown whatever its fields have been set to."""

import pytest

import sfmcpp


@pytest.mark.parametrize("name", ["cameras", "points", "camera_index", "pixels", "intrinsics"])
def test_a_field_that_is_none_is_no_hindrance(name: str) -> None:
    problem = sfmcpp.circle_scene(3, 12, seed=0)
    setattr(problem, name, None)
    assert repr(problem).startswith("Problem('calibrated': ")


def test_a_sound_problem_is_counted() -> None:
    shown = repr(sfmcpp.circle_scene(3, 12, seed=0))
    assert shown == "Problem('calibrated': 3 cameras, 12 points, 36 observations)"
