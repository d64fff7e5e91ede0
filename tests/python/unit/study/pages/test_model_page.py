"""The page of a model holds the model as it is; a browser draws it; a click on a camera shows its photo."""

from __future__ import annotations

import base64
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from browser_helpers import Ask, click, opened, opened_at, scene_in, screenshot, value_of
from sfm_runs import thumbnail
from sfmcpp.errors import InvalidArgument
from sfmcpp.model.photos import Photo
from sfmcpp.sources.synthetic import circle_scene
from sfmcpp.study.pages.model_page import ModelScene, model_page, save_model_page
from sfmcpp.study.pages.viewpoint import bounding_sphere, camera_size, turn_upright

RED = (220, 30, 40)


def circle(num_points: int = 400, turned: Rotation | None = None, **options: Any) -> ModelScene:
    """Six cameras around a cube of red points; all of it turned as one may like."""
    turn = (turned or Rotation.identity()).as_matrix()
    scene = circle_scene(6, num_points, seed=0)
    names = [f"photo {i:04d}.jpg" for i in range(6)]
    content: dict[str, Any] = {
        "title": "a circle",
        "points": scene.points @ turn.T,
        "colors": np.tile(np.array(RED, dtype=np.uint8), (num_points, 1)),
        "cameras": turn @ scene.cameras,
        "corners": np.tile([-0.32, -0.24, 0.32, 0.24], (6, 1)),
        "names": names,
        "notes": [f"note {i}" for i in range(6)],
        "thumbnails": [thumbnail(Photo(name)) for name in names],
    }
    return ModelScene(**{**content, **options})


def data_of(page: str) -> dict[str, Any]:
    """The scene that a page holds, with its arrays decoded."""
    content = scene_in(page, points=3, cameras=12, corners=4)
    content["colors"] = np.frombuffer(base64.b64decode(content["colors"]), "u1").reshape(-1, 3)
    return content


def test_the_page_holds_the_model_upright_about_its_middle() -> None:
    scene = circle()
    data = data_of(model_page(scene))
    assert data["names"] == scene.names
    np.testing.assert_array_equal(data["colors"], scene.colors)
    # A circle in the plane z = 0 is upright as it is, up to a turn about z.
    np.testing.assert_allclose(np.ptp(data["points"][:, 2]), np.ptp(scene.points[:, 2]), rtol=1e-6)
    poses = data["cameras"].reshape(-1, 3, 4)
    np.testing.assert_allclose(poses[:, 2, 1], -1, atol=1e-6)  # y of the cameras is down
    np.testing.assert_allclose(np.linalg.norm(poses[:, :2, 3], axis=1), 20, rtol=0.1)


def test_distances_between_cameras_and_points_are_kept() -> None:
    scene = circle(50)
    data = data_of(model_page(scene))
    there = np.linalg.norm(scene.points[:, None] - scene.cameras[None, :, :, 3], axis=2)
    here = np.linalg.norm(data["points"][:, None] - data["cameras"].reshape(-1, 3, 4)[None, :, :, 3], axis=2)
    np.testing.assert_allclose(here, there, rtol=1e-5)


def test_the_page_shows_the_same_however_the_world_is_turned() -> None:
    one, other = (
        data_of(model_page(circle(turned=turn))) for turn in (None, Rotation.from_rotvec([0.7, -1.1, 2.0]))
    )
    up = one["points"][:, 2] - one["cameras"][0, 11]
    np.testing.assert_allclose(other["points"][:, 2] - other["cameras"][0, 11], up, atol=1e-5)


def test_up_is_told_by_upright_photos_and_by_drones_that_look_down() -> None:
    down = np.zeros((8, 3, 4))
    for k in range(8):  # strips flown there and back, north is y
        heading = 1.0 if k % 2 else -1.0
        down[k, :, :3] = np.stack([[heading, 0, 0], [0, -heading, 0], [0, 0, -1.0]], axis=1)
        down[k, :, 3] = (k // 2, k % 4, 30)
    np.testing.assert_allclose(turn_upright(down)[2], [0, 0, 1], atol=1e-9)
    level = circle_scene(9, 10).cameras
    np.testing.assert_allclose(turn_upright(level)[2], [0, 0, 1], atol=1e-9)
    one = level[:1]
    np.testing.assert_allclose(
        turn_upright(one), np.stack([one[0, :, 0], one[0, :, 2], -one[0, :, 1]]), atol=1e-9
    )
    turn = turn_upright(np.empty((0, 3, 4)))
    np.testing.assert_allclose(turn @ turn.T, np.eye(3))
    assert np.linalg.det(turn) == pytest.approx(1.0)


def test_a_flight_that_keeps_its_heading_is_seen_from_above() -> None:
    rng = np.random.default_rng(0)
    # Straight down, a little ahead, a little back.
    for degrees in (0, 12, -12):
        flight = flight_of(Rotation.from_euler("x", degrees, degrees=True).as_matrix(), rng)
        turn = turn_upright(flight)
        assert turn[2, 2] > 0.99
        assert turn[1, 1] > 0.99
    # A way along a wall is no plane: the tops of the cameras are up.
    walk = np.tile(np.column_stack([np.eye(3), np.zeros(3)]), (40, 1, 1))
    walk[:, :, 3] = np.stack([0.5 * np.arange(40), rng.normal(0, 0.1, 40), rng.normal(0, 0.3, 40)], axis=1)
    assert turn_upright(walk)[2, 1] < -0.99


def flight_of(tilt: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Forty cameras above a field that look down, but for a tilt; the tops of their images are north."""
    down = tilt @ np.diag([1.0, -1.0, -1.0])
    flight = np.tile(np.column_stack([down, np.zeros(3)]), (40, 1, 1))
    flight[:, :, :3] = flight[:, :, :3] @ Rotation.from_euler("zyx", rng.normal(0, 0.03, (40, 3))).as_matrix()
    row, column = np.divmod(np.arange(40), 8)
    flight[:, :, 3] = np.stack([11.0 * column, 9.0 * row, 40 + rng.normal(0, 1.5, 40)], axis=1)
    return flight


def test_far_points_do_not_make_the_rest_small() -> None:
    rng = np.random.default_rng(0)
    points = np.concatenate([rng.uniform(-1, 1, (980, 3)), rng.uniform(500, 1000, (20, 3))])
    middle, radius = bounding_sphere(points, np.array([[0.0, -3, 0], [0.5, -3, 0]]))
    assert radius < 4
    assert np.linalg.norm(middle) < 3
    assert bounding_sphere(np.empty((0, 3)), np.empty((0, 3)))[1] == 1.0


def test_cameras_are_drawn_smaller_where_they_are_dense() -> None:
    line = np.zeros((50, 3))
    line[:, 0] = np.linspace(0, 10, 50)
    sparse, dense = camera_size(line[::10], 5.0), camera_size(line, 5.0)
    assert 0 < dense < sparse < 5.0


def test_more_points_than_a_page_can_show_are_thinned_and_that_is_said() -> None:
    count = 1_000_001
    scene = circle(
        points=np.zeros((count, 3)), colors=np.full((count, 3), 9, dtype=np.uint8), thumbnails=[None] * 6
    )
    data = data_of(model_page(scene))
    assert data["omitted"] == 2
    assert len(data["points"]) == len(data["colors"]) == 500_001


def test_points_without_colours_are_not_black_on_black() -> None:
    scene = circle(colors=np.zeros((400, 3), dtype=np.uint8))
    assert data_of(model_page(scene))["colors"].min() > 100


def test_the_same_scene_gives_the_same_text_and_nothing_is_fetched() -> None:
    page = model_page(circle())
    assert page == model_page(circle())
    assert not re.search(r"https?://|@import|url\(|src=\"(?!data:)|<link", page)


def test_names_cannot_break_out_of_the_page() -> None:
    evil = "</script><script>alert(1)</script>"
    scene = circle(title=evil, names=[evil] * 6, notes=[evil] * 6, facts={evil: evil})
    page = model_page(scene)
    assert evil not in page
    assert data_of(page)["names"] == [evil] * 6


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"names": ["a"]}, "names: 1 entries, must be 6, one for each camera"),
        ({"colors": np.zeros((3, 3), np.uint8)}, r"colors: shape \(3, 3\), must be \(400, 3\)"),
        ({"points": np.full((400, 3), np.nan)}, r"points\[0, 0\] = nan"),
    ],
)
def test_what_does_not_fit_is_refused(changes: dict[str, Any], told: str) -> None:
    with pytest.raises(InvalidArgument, match=told):
        circle(**changes)


def test_a_browser_draws_points_in_their_colours_and_cameras(tmp_path: Path) -> None:
    save_model_page(circle(3000), tmp_path / "view.html")
    picture = screenshot(tmp_path / "view.html", tmp_path / "view.png")
    assert near(picture, RED) > 1000
    assert near(picture, (240, 170, 150), 0.15) > 300  # cameras, as thin lines


def test_a_browser_draws_an_empty_model_without_failing(tmp_path: Path) -> None:
    empty = circle(
        points=np.empty((0, 3)),
        colors=np.empty((0, 3), np.uint8),
        cameras=np.empty((0, 3, 4)),
        corners=np.empty((0, 4)),
        names=[],
        notes=[],
        thumbnails=[],
    )
    save_model_page(empty, tmp_path / "view.html")
    picture = screenshot(tmp_path / "view.html", tmp_path / "view.png")
    assert picture[20:60, 20:200].std() > 0.02  # the heading


def test_a_click_on_a_camera_shows_its_photo_and_its_name(tmp_path: Path) -> None:
    scene = circle()
    save_model_page(scene, tmp_path / "view.html")
    with opened((tmp_path / "view.html").as_uri(), tmp_path) as ask:
        assert value_of(ask, "document.getElementById('photo').hidden") is True
        for number in (0, 2, 5):
            value_of(ask, "choose(-1)")  # the photo may cover another camera
            click(ask, *seen_at(ask, number))
            assert value_of(ask, "document.getElementById('name').textContent") == scene.names[number]
            shown = value_of(ask, "document.getElementById('picture').src")
            assert base64.b64decode(shown.split(",")[1]) == scene.thumbnails[number]
            assert value_of(ask, "document.getElementById('picture').naturalWidth") == 64
        click(ask, 20, 500)  # nothing is there
        assert value_of(ask, "document.getElementById('photo').hidden") is True


@pytest.mark.parametrize(("width", "height"), [(420, 800), (730, 415), (1400, 800)])
def test_bar_and_compass_are_beside_the_panels(tmp_path: Path, width: int, height: int) -> None:
    facts = {
        "images": "8 of 8",
        "points": "2,224",
        "mean error of observations": "0.026 px",
        "focal": "1380 px",
    }
    save_model_page(circle(facts=facts, unit="m", east_north_up=True), tmp_path / "view.html")
    with opened_at((tmp_path / "view.html").as_uri(), tmp_path, width, height) as ask:
        value_of(ask, "new Promise(requestAnimationFrame)")
        gauges, *panels = value_of(
            ask,
            """[element("gauges"), ...document.querySelectorAll(".panel")].map(shown => {
                const box = shown.getBoundingClientRect();
                return [box.left, box.right, box.top, box.bottom]; })""",
        )
    assert len(panels) >= 2
    left, right, top, bottom = gauges
    assert 0 <= left < right <= width
    assert 0 <= top < bottom <= height
    for panel in panels:
        assert right <= panel[0] or panel[1] <= left or bottom <= panel[2] or panel[3] <= top


def test_a_page_can_be_opened_at_a_camera(tmp_path: Path) -> None:
    save_model_page(circle(), tmp_path / "view.html")
    with opened((tmp_path / "view.html").as_uri() + "#photo%200003.jpg", tmp_path) as ask:
        assert value_of(ask, "document.getElementById('name').textContent") == "photo 0003.jpg"
        value_of(ask, "document.querySelector('#steps').children[2].click()")
        assert value_of(ask, "document.getElementById('name').textContent") == "photo 0004.jpg"


def seen_at(ask: Ask, number: int) -> list[float]:
    """Where the tip of a camera is in the window, as the page first shows it."""
    value_of(ask, "new Promise(requestAnimationFrame)")
    place: list[float] = value_of(
        ask, f"onScreen(inCamera(...centre({number}))).map(x => x * innerWidth / width)"
    )
    return place


def near(picture: np.ndarray, color: tuple[int, int, int], within: float = 0.06) -> int:
    """Number of pixels of nearly that colour."""
    return int((np.abs(picture - np.array(color) / 255).max(axis=2) < within).sum())
