"""The page of a reconstruction tells all there is to tell, of 11 images and of 1,000, on a phone as well."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from browser_helpers import opened, opened_at, screenshot, value_of
from sfm_runs import NO_MATCH, finished_run, gps_outcome, pair, run_without_model, thumbnail
from sfmcpp.map import Map
from sfmcpp.model.photos import Features, Photo
from sfmcpp.sfm import ImageOutcome, MatchGraph, SfmRun
from sfmcpp.study import SfmReport
from sfmcpp.study.pages.sfm_page import sfm_page

TITLE = re.compile(r"<title>(.*?)</title>")


def thumbnails(run: SfmRun) -> dict[str, bytes]:
    return {photo.name: thumbnail(photo) for photo in run.graph.photos}


def titles(page: str) -> list[str]:
    """What shows under the pointer."""
    return TITLE.findall(page)


def large_run(num_images: int = 1000) -> SfmRun:
    """Many images in a row, each matched with the next twenty."""
    rng = np.random.default_rng(0)
    names = [f"walk/{i:04d}.jpg" for i in range(num_images)]
    world = Map("perspective")
    world.add_cameras([[800.0, 1, 320, 240, *[0] * 8]] * num_images, sizes=[[640, 480]] * num_images)
    poses = np.tile(np.eye(3, 4), (num_images, 1, 1))
    poses[:, 0, 3] = np.arange(num_images)
    points = rng.uniform((-20, -3, 8), (num_images + 20, 3, 20), (5 * num_images, 3))
    seen = points[None] - poses[:, None, :, 3]
    pixels = 800 * seen[:, :, :2] / seen[:, :, 2:] + (320, 240)
    image, point = np.nonzero((np.abs(pixels - (320, 240)) < (320, 240)).all(axis=2))
    numbers = world.add_points(points, colors=rng.integers(0, 255, points.shape))
    world.add_images(
        names,
        np.arange(num_images),
        np.bincount(image, minlength=num_images),
        pixels[image, point] + rng.normal(0, 0.3, (len(image), 2)),
        points=numbers[point],
        poses=poses,
    )
    nothing = Features(
        *(np.zeros((0, n)) for n in (2,)), *[np.zeros(0)] * 2, *[np.zeros((0, 3), np.uint8)] * 2
    )
    pairs = [pair(i, j, 50, 40) for i in range(num_images) for j in range(i + 1, min(i + 21, num_images))]
    graph = MatchGraph([Photo(name) for name in names], [nothing] * num_images, pairs)
    return SfmRun("walk", {}, graph, [world], {name: ImageOutcome(True, 0) for name in names})


def test_all_images_and_their_reasons_are_on_the_page() -> None:
    run = finished_run(left_out=(2, 5), warnings=["the scene <repeats> itself"])
    page = sfm_page(SfmReport(run), thumbnails(run))
    assert "6 of 9 images are in the model." in page
    assert "the scene &lt;repeats&gt; itself" in page
    assert page.count(NO_MATCH) >= 3  # on top, and with both images
    assert page.count("data:image/jpeg;base64,") == 8
    for name in run.images:
        assert f'<td class="name">{name}</td>' in page
    assert "12 matches, 30 are needed" in page
    assert "set/photo 0000.jpg – set/photo 0001.jpg: 40 inliers" in titles(page)
    assert "set/photo 0000.jpg – set/photo 0002.jpg: no match" in titles(page)


def test_a_complete_model_is_told_as_such_and_holds_no_reasons() -> None:
    run = finished_run()
    del run.images["broken.jpg"]
    page = sfm_page(SfmReport(run))
    assert "All 8 images are in one model." in page
    assert "left out" not in page
    assert "GPS" not in page


def test_bars_of_tracks_and_images_tell_the_counts() -> None:
    run = finished_run()
    report = SfmReport(run)
    told = titles(sfm_page(report))
    for length, count in report.to_dict()["track_lengths"].items():
        assert f"{length} images: {count:,} points" in told
    facts = report.to_dict()["images"]["set/photo 0003.jpg"]
    error, count = facts["mean_error_px"], facts["observations"]
    assert f"set/photo 0003.jpg: {error:.3f} px, {count:,} observations" in told


def test_wrong_positions_stand_out() -> None:
    run = finished_run()
    run.gps = gps_outcome(run, outlier=3)
    page = sfm_page(SfmReport(run))
    marked = re.findall(r'<rect class="bar marked"[^>]*><title>(.*?)</title>', page)
    assert marked == ["set/photo 0003.jpg: 20 m"]
    assert "<td>set/photo 0003.jpg</td><td>20.00</td>" in page
    assert "48.2000000°, 16.3700000°, 180.00 m" in page


def test_without_a_model_the_page_says_why() -> None:
    page = sfm_page(SfmReport(run_without_model()))
    assert "No model: none of 4 images could be registered." in page
    assert "Reprojection errors" not in page
    assert NO_MATCH in page


def test_names_cannot_break_out_of_the_page() -> None:
    evil = '"><script>alert(1)</script>'
    run = finished_run(warnings=[evil], source=evil, options={evil: evil})
    run.models[0].image_names[0] = evil
    run.images[evil] = ImageOutcome(False, None, evil)
    run.graph.photos[0] = Photo(evil)
    run.graph.pairs.append(pair(0, 3, 20, 0, evil))
    assert "<script>alert" not in sfm_page(SfmReport(run))


def test_the_page_is_the_same_each_time_has_no_times_and_fetches_nothing() -> None:
    slow, fast = finished_run(seconds={"features": 1234.5}), finished_run(seconds={"features": 0.1})
    pages = [sfm_page(SfmReport(run), thumbnails(run)) for run in (slow, fast)]
    assert pages[0] == pages[1]
    assert not re.search(r"https?://|@import|url\(|src=\"(?!data:)|<link", pages[0])


def test_a_thousand_images_make_a_page_that_a_browser_can_hold() -> None:
    run = large_run()
    page = sfm_page(SfmReport(run), {name: b"x" * 6000 for name in run.images})
    assert page.count("data:image/jpeg;base64,") == 200
    assert page.count('<td class="name">') == 1000
    assert len(page) < 4e6
    assert "all 1,000 cameras of 640 × 480 together" in page
    assert 'alt="matrix of matching images"' in page


def test_a_browser_shows_the_summary_first(tmp_path: Path) -> None:
    run = finished_run(left_out=(2,))
    path = tmp_path / "report.html"
    path.write_text(sfm_page(SfmReport(run), thumbnails(run)))
    picture = screenshot(path, tmp_path / "page.png")
    orange = np.abs(picture - np.array([213, 94, 0]) / 255).max(axis=2) < 0.06
    assert orange[:100].sum() > 100  # the sentence that images are missing
    assert orange[100:].sum() > 100  # cameras, seen from above
    assert picture[100:400].std() > 0.05


@pytest.mark.parametrize(("width", "height"), [(360, 740), (420, 900), (900, 420), (1400, 900)])
def test_no_table_is_wider_than_its_box(tmp_path: Path, width: int, height: int) -> None:
    run = finished_run(left_out=(2,))
    run.gps = gps_outcome(run, outlier=3)
    path = tmp_path / "report.html"
    path.write_text(sfm_page(SfmReport(run), thumbnails(run)))
    with opened_at(path.as_uri(), tmp_path, width, height) as ask:
        value_of(ask, "document.querySelectorAll('details').forEach(folded => folded.open = true)")
        assert value_of(ask, "document.scrollingElement.scrollWidth <= innerWidth")
        boxes = "[...document.querySelectorAll('.scroll')].map(box => [box.clientWidth, box.scrollWidth])"
        for box, table in value_of(ask, boxes):
            assert 0 < table <= box
        # Where the head of a table is not above its cells, they tell their columns themselves.
        told = "getComputedStyle(document.querySelector('#cameras td'), '::before').content"
        assert value_of(ask, told) == ('"camera"' if width < 1000 else "none")


def test_on_a_phone_nothing_is_wider_than_the_window_and_columns_sort(tmp_path: Path) -> None:
    run = finished_run(left_out=(2,))
    path = tmp_path / "report.html"
    path.write_text(sfm_page(SfmReport(run), thumbnails(run)))
    with opened(path.as_uri(), tmp_path) as ask:
        ask("Emulation.setDeviceMetricsOverride", width=360, height=740, deviceScaleFactor=2, mobile=True)
        width, window = value_of(ask, "[document.documentElement.scrollWidth, innerWidth]")
        assert (width, window) == (360, 360)
        names = "[...document.querySelectorAll('#images td.name')].map(cell => cell.textContent)"
        first = value_of(ask, names)
        assert first[:2] == ["set/photo 0002.jpg", "broken.jpg"]  # those left out
        value_of(ask, "document.querySelectorAll('#images th')[4].click()")
        report = SfmReport(run).to_dict()["images"]
        errors = [report[name]["mean_error_px"] or -1 for name in value_of(ask, names)]
        assert errors == sorted(errors, reverse=True) or errors == sorted(errors)
        assert errors[0] != errors[-1]
