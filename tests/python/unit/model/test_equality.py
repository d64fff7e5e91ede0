"""Problems are compared by identity: `==` of their arrays has no single truth."""

import sfmcpp


def test_a_problem_equals_itself_alone() -> None:
    problem = sfmcpp.circle_scene(3, 12, seed=0)
    copy = problem.copy()
    assert problem == problem
    assert problem != copy
    assert problem.metadata != sfmcpp.Metadata(point_colors=problem.metadata.point_colors)
    assert len({problem, copy}) == 2
