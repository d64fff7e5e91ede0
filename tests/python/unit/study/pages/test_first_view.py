"""A page of a scene opens with all of it in the window, beside the panels, however wide the window is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from browser_helpers import Ask, opened_at, value_of
from sfmcpp.sources.synthetic import circle_scene
from sfmcpp.study.pages.model_page import ModelScene, save_model_page
from sfmcpp.study.pages.scene_page import Scene, save_scene_page

SIZES = [(420, 900), (900, 420), (1400, 900)]
FACTS = {f"fact number {i}": "1,234,567" for i in range(6)}
# Left, right, top and bottom of each panel that is shown.
BOXES = """[...document.querySelectorAll(".panel")].map(panel => panel.getBoundingClientRect())
    .filter(box => box.width).map(box => [box.left, box.right, box.top, box.bottom])"""
ALL_OF = "(array => Array.from({ length: array.length / 3 }, (_, i) => row(array, i)))"
CAMERAS = "Array.from({ length: numCameras }, (_, k) => [centre(k), ...cornersOf(k)]).flat()"
PATHS = f"[...{ALL_OF}(path), ...{ALL_OF}(truth)]"
PLACES = {"long model": CAMERAS, "round model": CAMERAS, "drive": PATHS}
ON_SCREEN = "place => onScreen(inCamera(...place)).map(x => x * innerWidth / width)"


def save(name: str, path: Path) -> None:
    """Write the page of that name."""
    {"long model": save_long_model, "round model": save_round_model, "drive": save_drive}[name](path)


def save_long_model(path: Path) -> None:
    """Forty cameras in a long row that look at points along the row; a few are far off."""
    rng = np.random.default_rng(1)
    cameras = np.tile(np.eye(3, 4), (40, 1, 1))
    cameras[:, 0, 3] = np.linspace(-30, 30, 40)
    points = rng.uniform((-30, -2, 8), (30, 2, 12), (2000, 3))
    points[:10] *= 1000
    colors = np.full((2000, 3), 200, np.uint8)
    corners = np.tile([-0.32, -0.24, 0.32, 0.24], (40, 1))
    names, nothing = [f"{i}.jpg" for i in range(40)], [None] * 40
    save_model_page(
        ModelScene("long", points, colors, cameras, corners, names, names, nothing, facts=FACTS), path
    )


def save_round_model(path: Path) -> None:
    """Cameras around a cube."""
    scene = circle_scene(12, 500, seed=0)
    colors = np.full((500, 3), 200, np.uint8)
    corners = np.tile([-0.32, -0.24, 0.32, 0.24], (12, 1))
    names = [f"{i}.jpg" for i in range(12)]
    save_model_page(
        ModelScene("round", scene.points, colors, scene.cameras, corners, names, names, [None] * 12, FACTS),
        path,
    )


def save_drive(path: Path) -> None:
    """A path along a street, points beside it, and a truth that leads elsewhere."""
    rng = np.random.default_rng(0)
    walls = rng.choice([-9.0, 9.0], 600)
    points = np.stack([walls, rng.uniform(-4, 1, 600), rng.uniform(-10, 60, 600)], axis=1)
    places = np.stack([np.zeros(51), np.zeros(51), np.linspace(0, 50, 51)], axis=1)
    cameras = np.tile(np.eye(3, 4), (51, 1, 1))
    cameras[:, :, 3] = places
    save_scene_page(Scene("drive", points, places, cameras, 2 * places, facts=FACTS, unit="m"), path)


def outside(ask: Ask, places: str, width: int, height: int) -> float:
    """Share of places that are beyond the window or under a panel."""
    at = np.array(value_of(ask, f"({places}).map({ON_SCREEN})"))
    beyond = (at < 0).any(axis=1) | (at > (width, height)).any(axis=1)
    for left, right, top, bottom in value_of(ask, BOXES):
        beyond |= ((at > (left, top)) & (at < (right, bottom))).all(axis=1)
    return float(beyond.mean())


@pytest.mark.parametrize(("width", "height"), SIZES)
@pytest.mark.parametrize("name", PLACES)
def test_all_of_a_scene_is_seen(tmp_path: Path, name: str, width: int, height: int) -> None:
    page = tmp_path / "view.html"
    save(name, page)
    with opened_at(page.as_uri(), tmp_path, width, height) as ask:
        for view in range(3):
            value_of(ask, f"element('views').children[{view}].click(); new Promise(requestAnimationFrame)")
            assert outside(ask, PLACES[name], width, height) == 0
            assert outside(ask, f"{ALL_OF}(points)", width, height) < 0.01
        assert value_of(ask, "document.scrollingElement.scrollWidth <= innerWidth")


@pytest.mark.parametrize("name", ["round model", "drive"])
def test_what_is_seen_fills_the_window(tmp_path: Path, name: str) -> None:
    page = tmp_path / "view.html"
    save(name, page)
    with opened_at(page.as_uri(), tmp_path, 1400, 900) as ask:
        value_of(ask, "new Promise(requestAnimationFrame)")
        at = np.array(value_of(ask, f"[...{PLACES[name]}, ...{ALL_OF}(points)].map({ON_SCREEN})"))
    assert (np.ptp(at, axis=0) > (0.6 * 1400, 0.75 * 900)).any()


@pytest.mark.parametrize(("width", "height"), SIZES)
@pytest.mark.parametrize("name", ["round model", "drive"])
def test_panels_are_beside_each_other(tmp_path: Path, name: str, width: int, height: int) -> None:
    page = tmp_path / "view.html"
    save(name, page)
    with opened_at(page.as_uri(), tmp_path, width, height) as ask:
        boxes = value_of(ask, BOXES)
    for left, right, top, bottom in boxes:
        assert 0 <= left < right <= width
        assert 0 <= top < bottom <= height
    for i, one in enumerate(boxes):
        for other in boxes[:i]:
            assert one[1] <= other[0] or other[1] <= one[0] or one[3] <= other[2] or other[3] <= one[2]


def test_a_window_that_is_turned_shows_all_again_unless_somebody_has_moved_the_view(tmp_path: Path) -> None:
    page = tmp_path / "view.html"
    save("round model", page)
    with opened_at(page.as_uri(), tmp_path, 900, 420) as ask:
        value_of(ask, "new Promise(requestAnimationFrame)")
        for touch in ("", "turn(5, 5); touched();"):
            value_of(ask, touch + "0")
            before = value_of(ask, "view.distance")
            for width, height in ((420, 900), (421, 899)):
                size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": True}
                ask("Emulation.setDeviceMetricsOverride", **size)
                value_of(ask, "new Promise(requestAnimationFrame)")
            if touch:
                assert value_of(ask, "view.distance") == before
            else:
                assert outside(ask, CAMERAS, 421, 899) == 0
