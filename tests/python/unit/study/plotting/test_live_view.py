"""The page shows the map as it grows, beside the run and not in its way."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from urllib.request import urlopen

import numpy as np
import pytest

import sfmcpp
from browser_helpers import SOFTWARE_3D, TIMEOUT_S, opened_at, screenshot_when
from sfmcpp.geometry.similarity import Similarity
from sfmcpp.slam import SlamResult, TrackSequence, run_slam
from sfmcpp.study.plotting import live_view
from sfmcpp.study.plotting.live_view import LiveView, load_viser

pytest.importorskip("viser", reason="viser is not installed: pip install 'sfmcpp[view]'")


@pytest.fixture
def view() -> Iterator[LiveView]:
    page = LiveView("a corridor")
    yield page
    page.close()


@pytest.fixture(scope="module")
def corridor() -> TrackSequence:
    scene = sfmcpp.corridor_scene(30, 2400, length_m=15.0, seed=2)
    t_s = 0.1 * np.arange(scene.num_cameras)
    return TrackSequence(t_s, scene.camera_index, scene.point_index, scene.pixels, scene.intrinsics[0])


@pytest.fixture(scope="module")
def result(corridor: TrackSequence) -> SlamResult:
    return run_slam(corridor)


def known_points(result: SlamResult) -> np.ndarray:
    assert result.world is not None
    return result.world.points[result.world.known]


def on_page(view: LiveView, name: str) -> np.ndarray:
    """Where the page draws the ends of the lines of that name."""
    return np.asarray(view._lines[name].points, np.float64)


def test_the_page_holds_all_points_the_path_and_the_keyframes(view: LiveView, result: SlamResult) -> None:
    view.show(result, "done")
    points = known_points(result)
    assert view.num_points == len(points) > 300
    np.testing.assert_allclose(view._points.points, points, rtol=1e-6, atol=1e-6)
    centres = result.trajectory().centres
    np.testing.assert_allclose(on_page(view, "path")[:, 0], centres[:-1], atol=1e-5)
    np.testing.assert_allclose(on_page(view, "path")[:, 1], centres[1:], atol=1e-5)
    # The first four lines of a camera start at its centre.
    world = result.world
    assert world is not None
    tips = on_page(view, "keyframes").reshape(len(world.keyframes), 8, 2, 3)[:, :4, 0]
    np.testing.assert_allclose(tips, np.repeat(world.poses[:, None, :, 3], 4, axis=1), atol=1e-5)


def test_the_grid_lies_under_the_map_and_the_legend_tells_its_cells(
    view: LiveView, result: SlamResult
) -> None:
    view.show(result, "done")
    cell = view._grid.cell_size / view._around[1]
    assert f"grid: {cell:g}" in view._legend.content
    heights = (known_points(result) - view._around[0]) @ view._turn[2] * view._around[1]
    assert np.mean(heights < view._grid.position[2]) < 0.05


@pytest.mark.parametrize(("least", "found"), [(0.011, 0.02), (1.0, 1.0), (2.5, 5.0), (7.0, 10.0)])
def test_cells_of_the_grid_are_round(least: float, found: float) -> None:
    assert live_view._round_length(least) == pytest.approx(found)


def test_the_page_follows_a_run_and_shows_the_last_of_it(view: LiveView, corridor: TrackSequence) -> None:
    counts: list[int] = []

    def listen(frame: int, result: SlamResult) -> None:
        view.show(result, f"frame {frame}")
        counts.append(view.num_points)

    found = run_slam(corridor, callback=listen)
    assert counts[0] == 0
    assert counts[-1] == len(known_points(found)) > counts[len(counts) // 2] > 0


def test_the_camera_is_in_the_middle_ahead_is_ahead_and_up_is_up(view: LiveView, result: SlamResult) -> None:
    from scipy.spatial.transform import Rotation

    view.show(result, "")
    w, *xyz = view._frame.wxyz
    turn = Rotation.from_quat([*xyz, w])
    world = result.world
    assert world is not None
    first, last = world.keyframes[0].pose, result.poses[max(result.poses)]
    np.testing.assert_allclose(turn.apply(first[:, 2]), [0, 1, 0], atol=1e-6)
    np.testing.assert_allclose(turn.apply(-first[:, 1]), [0, 0, 1], atol=1e-6)
    scale = view._points.scale
    np.testing.assert_allclose(scale * turn.apply(last[:, 3]) + view._frame.position, 0, atol=1e-6)


def test_a_map_is_drawn_as_large_whatever_its_unit(view: LiveView, corridor: TrackSequence) -> None:
    result = run_slam(corridor)
    view.show(result, "")
    size = view._points.scale * np.ptp(known_points(result), axis=0)
    similarity = Similarity(250.0, np.eye(3), np.ones(3))
    assert result.world is not None
    result.world.transform(similarity)
    result.path.transform(similarity)
    result.metric = not result.metric
    view.show(result, "")
    np.testing.assert_allclose(view._points.scale * np.ptp(known_points(result), axis=0), size, rtol=1e-6)


def test_more_points_than_a_browser_likes_are_thinned_evenly(
    view: LiveView, result: SlamResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live_view, "MOST_POINTS", 100)
    view.show(result, "")
    points = known_points(result)
    stride = -(-len(points) // 100)
    np.testing.assert_allclose(view._points.points, points[::stride], rtol=1e-6, atol=1e-6)
    assert 50 < view.num_points <= 100


def test_ten_pictures_a_second_are_due_and_fewer_where_they_take_long(
    view: LiveView, result: SlamResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock: list[float] = []
    monkeypatch.setattr(live_view, "time", SimpleNamespace(perf_counter=lambda: clock.pop(0)))

    def is_due(at_s: float) -> bool:
        clock.append(at_s)
        return view.due

    assert is_due(7.0)
    for began_s, ended_s, next_s in ((7.0, 7.001, 7.1), (8.0, 8.5, 18.0)):
        clock.extend([began_s, ended_s])
        view.show(result, "")
        assert not is_due(next_s - 0.001)
        assert is_due(next_s + 0.001)


def test_a_run_without_a_map_shows_its_status_alone(view: LiveView) -> None:
    view.show(SlamResult(), "initialising")
    assert view.num_points == 0
    assert view._status.content == "initialising"


def test_the_page_says_what_it_waits_for_and_what_colours_mean_before_there_is_a_map(view: LiveView) -> None:
    assert view._status.content == "waiting for the first frame"
    assert "points, low to high" in view._legend.content
    assert "grid" not in view._legend.content


def test_on_a_phone_the_eye_stands_back(view: LiveView, tmp_path: Path) -> None:
    """A window twice as high as wide shows from side to side what a square one does at the usual distance."""
    eye, looked_at = (
        np.array(getattr(view._server.initial_camera, name)) for name in ("position", "look_at")
    )
    usual = np.linalg.norm(eye - looked_at)
    with opened_at(view.url, tmp_path, 420, 840, SOFTWARE_3D):
        deadline = time.monotonic() + TIMEOUT_S
        distance = 0.0
        while distance < 1.9 * usual and time.monotonic() < deadline:
            time.sleep(0.1)
            for client in view._server.get_clients().values():
                distance = float(np.linalg.norm(client.camera.position - client.camera.look_at))
    assert distance == pytest.approx(2 * usual, rel=0.01)


def test_the_next_free_port_is_taken_and_nothing_is_printed(
    view: LiveView, capfd: pytest.CaptureFixture[str]
) -> None:
    other = LiveView("another")
    assert other.url != view.url
    for page in (view, other):
        with urlopen(page.url) as answer:
            assert answer.status == 200
    other.close()
    assert capfd.readouterr() == ("", "")


def test_a_missing_viser_is_named_with_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(ModuleNotFoundError, match=r"needs viser: pip install 'sfmcpp\[view\]'"):
        load_viser()


def test_a_browser_draws_the_map(view: LiveView, corridor: TrackSequence, tmp_path: Path) -> None:
    result = run_slam(corridor, callback=lambda frame, found: view.show(found, f"frame {frame}"))
    view.show(result, "done")

    def counts(picture: np.ndarray) -> tuple[int, int]:
        drawing = picture[150:, :650]  # beside the panels
        colored = (drawing.max(axis=2) - drawing.min(axis=2)) > 0.25
        red = (drawing[:, :, 0] > 0.8) & (drawing[:, :, 2] < 0.6) & (drawing[:, :, 1] < 0.75)
        return int(colored.sum()), int(red.sum())

    picture = screenshot_when(view.url, tmp_path, lambda p: counts(p)[0] > 3000 and counts(p)[1] > 200)
    points, path = counts(picture)
    assert points > 3000
    assert path > 200
