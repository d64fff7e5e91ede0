"""Match graphs of arrays: geometry as the true cameras have it, and wrong arrays named."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from sfmcpp.errors import InvalidArgument
from sfmcpp.sfm.imported_matches import match_graph_of_arrays
from sfmcpp.sfm.match_graph import unique_matches

RNG = np.random.default_rng(4)
POINTS = np.column_stack([RNG.uniform(-2, 2, (60, 2)), RNG.uniform(4, 9, 60)])
CENTRES = np.array([[0.0, 0, 0], [1, 0.1, 0], [2, -0.1, 0.3]])
ROW = np.array([800.0, 1, 500, 400, 0, 0, 0, 0, 0, 0, 0, 0])
EACH = np.column_stack([np.arange(60), np.arange(60)])


def keypoints() -> list[np.ndarray[Any, Any]]:
    seen = POINTS[None] - CENTRES[:, None]
    return list(800 * seen[:, :, :2] / seen[:, :, 2:] + (500, 400))


def test_pairs_are_sorted_and_have_the_geometry_of_the_cameras() -> None:
    pytest.importorskip("poselib", reason="PoseLib is not installed: pip install 'sfmcpp[vision]'")
    order = RNG.permutation(60)
    shuffled = np.column_stack([order, order])
    graph = match_graph_of_arrays(
        keypoints(), {(2, 0): shuffled, (0, 1): EACH}, sizes=[(1000, 800)] * 3, intrinsics=[ROW] * 3
    )
    assert [(pair.first, pair.second) for pair in graph.pairs] == [(0, 1), (0, 2)]
    assert [photo.name for photo in graph.photos] == ["0000", "0001", "0002"]
    assert {photo.size for photo in graph.photos} == {(1000, 800)}
    for pair in graph.pairs:
        baseline = CENTRES[pair.second] - CENTRES[pair.first]
        assert pair.geometry.kind == "general"
        assert len(pair.verified) == 60
        np.testing.assert_array_equal(pair.matches[:, 0], pair.matches[:, 1])
        np.testing.assert_allclose(pair.geometry.camera[:, :3], np.eye(3), atol=1e-6)
        np.testing.assert_allclose(pair.geometry.camera[:, 3], baseline / np.linalg.norm(baseline), atol=1e-6)


def test_the_result_does_not_depend_on_the_number_of_threads() -> None:
    pytest.importorskip("poselib", reason="PoseLib is not installed: pip install 'sfmcpp[vision]'")
    noisy = [pixels + RNG.normal(0, 0.5, pixels.shape) for pixels in keypoints()]
    graphs = [
        match_graph_of_arrays(noisy, {(0, 1): EACH, (1, 2): EACH, (0, 2): EACH}, threads=threads)
        for threads in (1, 3)
    ]
    for one, other in zip(graphs[0].pairs, graphs[1].pairs, strict=True):
        assert one.geometry.fundamental.tobytes() == other.geometry.fundamental.tobytes()
        np.testing.assert_array_equal(one.geometry.inliers, other.geometry.inliers)


def test_what_is_not_given_is_unknown_or_as_large_as_the_keypoints_need() -> None:
    places = [np.array([[10.0, 20.5], [99.2, 3.0]]), np.array([[5.0, 49.5]]), np.empty((0, 2))]
    graph = match_graph_of_arrays(places, {(0, 1): np.empty((0, 2))}, names=["a", "b", "c"])
    assert {photo.size for photo in graph.photos} == {(100, 50)}
    assert [photo.name for photo in graph.photos] == ["a", "b", "c"]
    assert np.isnan(graph.features[0].scales).all()
    assert graph.features[0].descriptors.shape == (2, 0)
    assert graph.pairs[0].geometry.kind == "none"
    assert graph.pairs[0].matches.shape == (0, 2)


def test_scales_and_colours_are_kept() -> None:
    places = [np.ones((2, 2)), np.ones((1, 2))]
    graph = match_graph_of_arrays(
        places, {}, scales=[[1.5, 2.5], [3.0]], colors=[[(1, 2, 3), (4, 5, 6)], [(255, 0, 9)]]
    )
    np.testing.assert_array_equal(graph.features[0].scales, [1.5, 2.5])
    np.testing.assert_array_equal(graph.features[1].colors, [[255, 0, 9]])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"keypoints": []}, "keypoints: is empty"),
        ({"keypoints": [np.ones((3, 3))] * 3}, r"keypoints\[0\]: shape \(3, 3\)"),
        ({"keypoints": [np.ones((3, 2)), [[np.nan, 1]], []]}, r"keypoints\[1\]\[0, 0\] = nan"),
        ({"scales": [np.ones(60), np.append(np.ones(59), np.inf), np.ones(60)]}, r"scales\[1\]\[59\] = inf"),
        ({"scales": [-np.ones(60), np.ones(60), np.ones(60)]}, r"scales\[0\]\[0\] = -1: must be finite, not"),
        ({"matches": {(0, 3): EACH}}, r"matches\[\(0, 3\)\]: must be of two different images from 0 to 2"),
        ({"matches": {(1, 1): EACH}}, r"matches\[\(1, 1\)\]: must be of two different"),
        ({"matches": {"01x": EACH}}, r"matches\[01x\]: the key must be the numbers of two images"),
        ({"matches": {(0, 1.5): EACH}}, r"matches\[\(0, 1\.5\)\]: the key must be the numbers of two images"),
        ({"matches": {(0, 1): EACH, ("0", "1"): EACH}}, r"the key must be the numbers of two images"),
        ({"matches": {(0, 1): EACH, (1, 0): EACH}}, r"has both \(0, 1\) and \(1, 0\)"),
        ({"matches": {(0, 1): EACH.T}}, r"matches\[\(0, 1\)\]: shape \(2, 60\)"),
        ({"matches": {(0, 1): [(0, 60)]}}, r"\[0, 1\] = 60: must be the number of one of the 60 keypoints"),
        ({"matches": {(0, 1): [(3, 3), (-1, 4)]}}, r"\[1, 0\] = -1: must be the number"),
        ({"matches": {(0, 1): [(0.5, 1)]}}, r"\[0, 0\] = 0\.5: must be the number"),
        ({"matches": {(0, 1): [(7, 1), (7, 2)]}}, "keypoint 7 of column 0 matches more than one"),
        ({"sizes": [(10, 10)] * 2}, r"sizes: shape \(2, 2\)"),
        ({"sizes": [(10, 10), (10, 0), (1, 1)]}, r"sizes\[1\] = \[10\.0, 0\.0\]"),
        ({"names": ["a", "b"]}, "names: has 2 entries, must have 3"),
        ({"names": ["a", "b", "a"]}, "names: 'a' is there more than once"),
        ({"names": ["a", "b", " c.jpg"]}, "names: ' c.jpg' must not be empty, start or end with white space"),
        ({"scales": [np.ones(60)] * 2}, "scales: has 2 entries, must have 3"),
        ({"scales": [np.ones(59)] * 3}, r"scales\[0\]: shape \(59,\)"),
        ({"colors": [np.full((60, 3), 256)] * 3}, r"colors\[0\]: must be from 0 to 255"),
        ({"intrinsics": [ROW]}, "intrinsics: has 1 entries, must have 3"),
    ],
)
def test_arrays_that_do_not_go_together_are_refused(changes: dict[str, Any], message: str) -> None:
    arguments: dict[str, Any] = {"keypoints": keypoints(), "matches": {(0, 1): EACH}, **changes}
    with pytest.raises(InvalidArgument, match=message):
        match_graph_of_arrays(**arguments)


def test_a_feature_that_matches_several_matches_none() -> None:
    found = np.array([[5, 5], [1, 2], [1, 3], [4, 4], [6, 4], [5, 5], [0, 9]], np.int32)
    np.testing.assert_array_equal(unique_matches(found), [[0, 9], [5, 5]])
    assert unique_matches(np.empty((0, 2), np.int32)).shape == (0, 2)


def test_a_graph_is_shown_in_one_line() -> None:
    """In place of its arrays, which are the size of the set."""
    graph = match_graph_of_arrays(keypoints(), {(2, 0): EACH, (0, 1): EACH[:9]}, sizes=[(1000, 800)] * 3)
    assert repr(graph) == "MatchGraph(3 images, 1 of 2 pairs match)"
