"""What a problem is to Python: compared by identity, as its arrays have no single truth, and always shown."""

import pytest

import sfmcpp


def test_a_problem_equals_itself_alone() -> None:
    problem = sfmcpp.circle_scene(3, 12, seed=0)
    copy = problem.copy()
    assert problem == problem
    assert problem != copy
    assert problem.metadata != sfmcpp.Metadata(point_colors=problem.metadata.point_colors)
    assert len({problem, copy}) == 2


@pytest.mark.parametrize("name", ["cameras", "points", "camera_index", "pixels", "intrinsics"])
def test_a_field_that_is_none_is_no_hindrance(name: str) -> None:
    problem = sfmcpp.circle_scene(3, 12, seed=0)
    setattr(problem, name, None)
    assert repr(problem).startswith("Problem('calibrated': ")


def test_a_sound_problem_is_counted() -> None:
    shown = repr(sfmcpp.circle_scene(3, 12, seed=0))
    assert shown == "Problem('calibrated': 3 cameras, 12 points, 36 observations)"
