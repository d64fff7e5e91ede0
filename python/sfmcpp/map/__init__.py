"""A map of images, cameras and points, in any order: SLAM and structure from motion stand on it."""

from sfmcpp.map.files import map_of_problem, problem_of_map, read_map, write_map
from sfmcpp.map.map import LocalProblem, Map

__all__ = ["LocalProblem", "Map", "map_of_problem", "problem_of_map", "read_map", "write_map"]
