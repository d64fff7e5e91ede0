"""The page holds the scene it is given, as it is, and a browser draws it."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from browser_helpers import opened, scene_in, screenshot, value_of
from sfmcpp.errors import InvalidArgument
from sfmcpp.study.pages.scene_page import Scene, save_scene_page, scene_page


def street(points: int = 400, turned: Rotation | None = None, **options: Any) -> Scene:
    """A camera that drives ten metres along z past two rows of points; all of it turned as one may like."""
    turn = (turned or Rotation.identity()).as_matrix()
    rng = np.random.default_rng(0)
    sides = rng.choice([-3.0, 3.0], points)
    cloud = np.stack([sides, rng.uniform(-4, 1, points), rng.uniform(0, 14, points)], axis=1)
    path = np.stack([np.zeros(21), np.zeros(21), np.linspace(0, 10, 21)], axis=1)
    cameras = np.tile(np.eye(3, 4), (5, 1, 1))
    cameras[:, :, 3] = path[::5]
    return Scene("a street", cloud @ turn.T, path @ turn.T, turn @ cameras, **options)


def data_of(page: str) -> dict[str, Any]:
    """The scene that a page holds, with its arrays decoded."""
    return scene_in(page, points=3, path=3, truth=3, cameras=12)


def test_the_page_holds_the_scene_with_x_right_y_ahead_and_z_up() -> None:
    scene = street()
    data = data_of(scene_page(scene))
    ahead_up = scene.points[:, [0, 2, 1]] * [1, 1, -1] - [0, 5, 0]
    np.testing.assert_allclose(data["points"], ahead_up, atol=1e-6)
    np.testing.assert_allclose(data["path"][[0, -1]], [[0, -5, 0], [0, 5, 0]], atol=1e-6)
    np.testing.assert_allclose(data["cameras"][0].reshape(3, 4)[:, 3], [0, -5, 0], atol=1e-6)
    np.testing.assert_allclose(data["cameras"][0].reshape(3, 4)[:, 2], [0, 1, 0], atol=1e-6)


@pytest.mark.parametrize(("width", "is_open"), [(420, False), (1000, True)])
def test_the_panel_is_folded_on_a_small_screen_and_breaks_names_at_their_separators(
    tmp_path: Path, width: int, is_open: bool
) -> None:
    page = tmp_path / "view.html"
    save_scene_page(replace(street(), title="drive_0005_sync & <more>"), page)
    size = ("--disable-gpu", f"--window-size={width},700")
    with opened(page.as_uri(), tmp_path, size) as ask:
        assert value_of(ask, "document.getElementById('about').open") is is_open
        heading = value_of(ask, "document.querySelector('h1').innerHTML")
    assert heading == "drive_<wbr>0005_<wbr>sync &amp; &lt;more&gt;"


def test_the_page_shows_the_same_however_the_world_is_turned() -> None:
    one = data_of(scene_page(street()))
    other = data_of(scene_page(street(turned=Rotation.from_rotvec([0.7, -1.1, 2.0]))))
    for name in ("points", "path", "cameras"):
        np.testing.assert_allclose(other[name], one[name], atol=1e-5)


def test_a_camera_that_looks_straight_down_is_shown_too() -> None:
    down = np.zeros((2, 3, 4))
    down[:, :, :3] = np.diag([1.0, -1.0, -1.0])
    down[1, 0, 3] = 1.0
    data = data_of(scene_page(Scene("down", np.ones((1, 3)), down[:, :, 3], down)))
    axes = data["cameras"][0].reshape(3, 4)[:, :3]
    np.testing.assert_allclose(axes.T @ axes, np.eye(3), atol=1e-6)
    np.testing.assert_allclose(np.linalg.det(axes), 1.0, atol=1e-6)


def test_heights_are_counted_from_the_first_centre() -> None:
    scene = street()
    scene.path[-1, 1] = -2.0  # two metres up
    data = data_of(scene_page(scene))
    heights = data["points"][:, 2] + data["originHeight"]
    np.testing.assert_allclose(heights, -scene.points[:, 1], atol=1e-6)


def test_the_same_scene_gives_the_same_text_and_nothing_is_fetched() -> None:
    page = scene_page(street())
    assert page == scene_page(street())
    assert not re.search(r"https?://|src=|@import|url\(", page)


def test_titles_and_facts_cannot_break_out_of_the_page() -> None:
    evil = "</script><script>alert(1)</script>"
    page = scene_page(
        Scene(evil, np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 3, 4)), facts={evil: evil})
    )
    assert evil not in page
    assert data_of(page)["facts"] == [[evil, evil]]


def test_numbers_that_are_not_finite_are_refused() -> None:
    with pytest.raises(InvalidArgument, match=r"points\[0, 1\] = nan"):
        Scene("bad", np.array([[0.0, np.nan, 0.0]]), np.empty((0, 3)), np.empty((0, 3, 4)))


def test_a_browser_draws_path_and_points_in_their_colours(tmp_path: Path) -> None:
    truth = street().path + np.array([0.5, 0.0, 0.0])
    scene = street(truth=truth, truth_name="truth", predicted=np.arange(8, 12))
    save_scene_page(scene, tmp_path / "view.html")
    picture = screenshot(tmp_path / "view.html", tmp_path / "view.png")
    drawing = picture[:560, 300:]  # beside and above the panels
    assert drawing.std() > 0.03
    assert count_near(drawing, (255, 122, 89)) > 500  # the path, a line across most of the window
    assert count_near(drawing, (242, 193, 78)) > 100  # the truth, dashed
    assert count_near(drawing, (224, 90, 208)) > 100  # predicted frames
    saturated = (drawing.max(axis=2) - drawing.min(axis=2)) > 0.25
    assert saturated.sum() > 1500


def test_a_browser_draws_an_empty_scene_without_failing(tmp_path: Path) -> None:
    empty = Scene("empty", np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 3, 4)))
    save_scene_page(empty, tmp_path / "view.html")
    picture = screenshot(tmp_path / "view.html", tmp_path / "view.png")
    panel = picture[640:690, 300:700]
    assert panel.std() > 0.02  # the text of the lower panel


def test_large_numbers_stay_within_the_panel(tmp_path: Path) -> None:
    small = street(unit="m")
    cameras = small.cameras * np.array([1, 1, 1, 1e12])
    large = replace(small, points=1e12 * small.points, path=1e12 * small.path, cameras=cameras)
    save_scene_page(large, tmp_path / "view.html")
    with opened((tmp_path / "view.html").as_uri(), tmp_path) as ask:
        texts = value_of(ask, "['heights', 'grid'].map(name => element(name).textContent)")
        wide = value_of(
            ask, "(({ scrollWidth, clientWidth }) => scrollWidth - clientWidth)(element('about'))"
        )
    assert re.fullmatch(r"-?\d\.\d\de\+\d+ mheight\d\.\d\de\+\d+ mgrid: \d\.\d\de\+\d+ m", "".join(texts))
    assert wide <= 0


def count_near(picture: np.ndarray, color: tuple[int, int, int]) -> int:
    """Number of pixels of nearly that colour."""
    return int((np.abs(picture - np.array(color) / 255).max(axis=2) < 0.06).sum())


def test_north_is_turned_with_the_world_and_absent_where_nobody_knows() -> None:
    assert data_of(scene_page(street()))["north"] is None
    turn = Rotation.from_rotvec([-np.pi / 2, 0, 0])  # the street leads north: y of the world, z up
    north = data_of(scene_page(street(turned=turn.inv() * Rotation.identity(), east_north_up=True)))["north"]
    ahead = data_of(scene_page(street(turned=turn, east_north_up=True)))["north"]
    np.testing.assert_allclose(ahead, [0, 1, 0], atol=1e-9)
    np.testing.assert_allclose(north, [0, -1, 0], atol=1e-9)


@pytest.mark.parametrize("width", [420, 1400])
def test_a_bar_of_some_metres_is_as_long_as_they_are_in_the_view(tmp_path: Path, width: int) -> None:
    save_scene_page(street(unit="m"), tmp_path / "view.html")
    with opened("about:blank", tmp_path) as ask:
        ask(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=800,
            deviceScaleFactor=2,
            mobile=width < 600,
        )
        ask("Page.navigate", url=(tmp_path / "view.html").as_uri())
        value_of(ask, "top_.onclick(); view.target[2] = 0; redraw(); new Promise(requestAnimationFrame)")
        text, long, left, right = value_of(
            ask,
            """(() => { const box = element("bar").getBoundingClientRect();
                return [element("scale").textContent, box.width, box.left, box.right]; })()""",
        )
        # From above, a path of ten metres in the plane of the target, in pixels of the page.
        ends = value_of(
            ask,
            "[0, poses - 1].map(i => onScreen(inCamera(...row(path, i))).map(x => x * innerWidth / width))",
        )
        panel = value_of(ask, "element('about').getBoundingClientRect().right")
    metres = float(text.strip().removesuffix(" m"))
    pixels_of_a_metre = np.linalg.norm(np.subtract(*ends)) / 10
    assert long == pytest.approx(metres * pixels_of_a_metre, rel=0.02)
    assert 0 < left < right < width
    assert width > 600 or left > panel


def test_a_world_without_metres_has_no_bar(tmp_path: Path) -> None:
    save_scene_page(street(), tmp_path / "view.html")
    with opened((tmp_path / "view.html").as_uri(), tmp_path) as ask:
        value_of(ask, "new Promise(requestAnimationFrame)")
        assert (
            value_of(ask, "[element('scale').hidden, element('compass').hasAttribute('hidden')]")
            == [True] * 2
        )
