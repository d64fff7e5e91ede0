"""Match graphs of folders of photos: complete, the same in every run, and nothing computed twice."""

from __future__ import annotations

import threading
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.sfm import front_end
from sfmcpp.sfm.cache import Cache
from sfmcpp.sfm.front_end import FrontEndSettings, build_match_graph
from sfmcpp.sfm.match_graph import MatchGraph
from sfmcpp.sources.vision import FeatureSettings, open_photos
from textured_photos import cut_short, texture, write_photo

for extra in ("cv2", "PIL", "poselib"):
    pytest.importorskip(extra, reason=f"{extra} is not installed: pip install 'sfmcpp[vision]'")

# Parts of one flat scene: each shifted against the last.
SCENE = texture(240, 420, seed=11)
SHIFT = 35
SETTINGS = FrontEndSettings(FeatureSettings(max_features=500), matcher="exhaustive", threads=2)


def write_set(folder: Path, count: int) -> Path:
    for k in range(count):
        write_photo(folder / f"{k}.png", SCENE[:, SHIFT * k : SHIFT * k + 250])
    return folder


def graph_of(folder: Path, cache: Path | None = None, **options: Any) -> MatchGraph:
    settings = options.pop("settings", SETTINGS)
    return build_match_graph(
        open_photos(folder), settings, cache=None if cache is None else Cache(cache), **options
    )


def assert_same(one: MatchGraph, other: MatchGraph) -> None:
    for some, others in ((one.features, other.features), (one.pairs, other.pairs)):
        assert len(some) == len(others)
    for a, b in zip(one.features, other.features, strict=True):
        assert [v.tobytes() for v in vars(a).values()] == [v.tobytes() for v in vars(b).values()]
    for p, q in zip(one.pairs, other.pairs, strict=True):
        assert (p.first, p.second, p.matches.tobytes()) == (q.first, q.second, q.matches.tobytes())
        for name, value in vars(p.geometry).items():
            np.testing.assert_array_equal(value, getattr(q.geometry, name), err_msg=name)


class Calls:
    """How often each stage computes something."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.counts: Counter[str] = Counter()
        self._lock = threading.Lock()
        for name in ("detect", "match", "geometry_of_matches"):
            monkeypatch.setattr(front_end, name, self._counted(name, getattr(front_end, name)))

    def _counted(self, name: str, function: Any) -> Any:
        def call(*arguments: Any, **options: Any) -> Any:
            with self._lock:
                self.counts[name] += 1
            return function(*arguments, **options)

        return call

    def since(self) -> tuple[int, int, int]:
        """Features, matches and geometries computed since it was asked last."""
        found = tuple(self.counts[name] for name in ("detect", "match", "geometry_of_matches"))
        self.counts.clear()
        return found  # type: ignore[return-value]


def test_all_pairs_of_a_shifted_scene_agree_with_the_shift(tmp_path: Path) -> None:
    graph = graph_of(write_set(tmp_path, 3))
    assert [(pair.first, pair.second) for pair in graph.pairs] == [(0, 1), (0, 2), (1, 2)]
    for pair in graph.pairs:
        one, other = graph.features[pair.first], graph.features[pair.second]
        moved = one.pixels[pair.verified[:, 0]] - other.pixels[pair.verified[:, 1]]
        assert pair.geometry.kind == "planar"
        assert len(pair.verified) > 50
        off = np.abs(moved - [SHIFT * (pair.second - pair.first), 0]).max(axis=1)
        # A large blob is placed worse than a small one.
        assert (off <= np.maximum(1.0, one.scales[pair.verified[:, 0]] / 2)).all()
        assert np.median(off) < 0.1


def test_a_place_is_matched_once_though_it_has_several_features(tmp_path: Path) -> None:
    graph = graph_of(write_set(tmp_path, 2))
    (pair,) = graph.pairs
    for features, numbers in zip(graph.features, pair.matches.T, strict=True):
        assert len(np.unique(features.pixels, axis=0)) < len(features)
        assert len(np.unique(features.pixels[numbers], axis=0)) == len(numbers)


def test_the_graph_does_not_depend_on_threads_or_the_cache(tmp_path: Path) -> None:
    folder = write_set(tmp_path / "photos", 3)
    graphs = [
        graph_of(folder, settings=FrontEndSettings(SETTINGS.features, threads=threads)) for threads in (1, 3)
    ]
    graphs += [graph_of(folder, tmp_path / "cache") for _ in range(2)]
    for graph in graphs[1:]:
        assert_same(graphs[0], graph)


def test_one_more_photo_costs_its_own_pairs_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls, cache = Calls(monkeypatch), tmp_path / "cache"
    folder = write_set(tmp_path / "photos", 3)
    graph_of(folder, cache)
    assert calls.since() == (3, 3, 3)
    graph_of(folder, cache)
    assert calls.since() == (0, 0, 0)
    # Its name puts it between the others.
    write_photo(folder / "1a.png", SCENE[:, 50:300])
    assert len(graph_of(folder, cache).pairs) == 6
    assert calls.since() == (1, 3, 3)


def test_pairs_are_chosen_once_for_the_same_photos_by_the_same_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, chosen = write_set(tmp_path / "photos", 3), []
    choose = front_end.choose_pairs
    monkeypatch.setattr(
        front_end, "choose_pairs", lambda *a, **o: chosen.append(choose(*a, **o)) or chosen[-1]
    )
    pairs = [[(p.first, p.second) for p in graph_of(folder, tmp_path / "cache").pairs] for _ in range(2)]
    assert pairs == [chosen[0]] * 2
    next(folder.iterdir()).rename(folder / "9.png")
    graph_of(folder, tmp_path / "cache")
    graph_of(folder, tmp_path / "cache", settings=replace(SETTINGS, matcher="sequential"))
    assert len(chosen) == 3


@pytest.mark.parametrize(
    ("changes", "computed"),
    [
        ({"features": FeatureSettings(max_features=400)}, (2, 1, 1)),
        ({"ratio": 0.7}, (0, 1, 1)),
        ({"mutual": False}, (0, 1, 1)),
        ({"threshold_px": 1.0}, (0, 0, 1)),
        ({"min_inliers": 20}, (0, 0, 1)),
        ({"seed": 5}, (0, 0, 1)),
        ({"threads": 1}, (0, 0, 0)),
    ],
)
def test_a_change_of_settings_costs_what_depends_on_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, changes: dict[str, Any], computed: tuple[int, int, int]
) -> None:
    folder, calls = write_set(tmp_path / "photos", 2), Calls(monkeypatch)
    before = {"features": SETTINGS.features, "matcher": "exhaustive", "threads": 2}
    graph_of(folder, tmp_path / "cache", settings=FrontEndSettings(**before))
    calls.since()
    changed = FrontEndSettings(**{**before, **changes})
    kept = graph_of(folder, tmp_path / "cache", settings=changed)
    assert calls.since() == computed
    assert_same(kept, graph_of(folder, settings=changed))


def test_other_intrinsics_cost_the_geometry_of_their_pairs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, calls = write_set(tmp_path / "photos", 3), Calls(monkeypatch)
    row = np.array([300.0, 1, 125, 120, 0, 0, 0, 0, 0, 0, 0, 0])
    graph_of(folder, tmp_path / "cache", intrinsics=[row] * 3)
    calls.since()
    graph_of(folder, tmp_path / "cache", intrinsics=[row, row, None])
    assert calls.since() == (0, 0, 2)


def test_a_photo_of_the_same_name_with_other_content_is_computed_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, calls = write_set(tmp_path / "photos", 2), Calls(monkeypatch)
    graph_of(folder, tmp_path / "cache")
    calls.since()
    write_photo(folder / "1.png", SCENE[:, 60:310])
    graph = graph_of(folder, tmp_path / "cache")
    assert calls.since() == (1, 1, 1)
    assert_same(graph, graph_of(folder))


def test_damaged_entries_of_the_cache_are_computed_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, calls = write_set(tmp_path / "photos", 2), Calls(monkeypatch)
    first = graph_of(folder, tmp_path / "cache")
    for file in (tmp_path / "cache").rglob("*"):
        if file.is_file():
            cut_short(file)
    calls.since()
    assert_same(graph_of(folder, tmp_path / "cache"), first)
    assert calls.since() == (2, 1, 1)


@pytest.mark.parametrize("stage", ["features", "pairs", "matching", "geometry"])
def test_a_run_that_was_stopped_in_any_stage_goes_on_where_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stage: str
) -> None:
    folder, calls = write_set(tmp_path / "photos", 3), Calls(monkeypatch)
    one_thread = FrontEndSettings(SETTINGS.features, "exhaustive", threads=1)
    with pytest.raises(KeyboardInterrupt):
        graph_of(
            folder,
            tmp_path / "cache",
            settings=one_thread,
            progress=lambda at, done, total: (at, done) == (stage, 1),
        )
    before = np.array(calls.since())
    graph = graph_of(folder, tmp_path / "cache")
    # What was begun when the stop was asked for may have been finished.
    np.testing.assert_array_equal(before + calls.since(), [3, 3, 3])
    assert_same(graph, graph_of(folder))


def test_a_stop_is_heeded_while_pairs_are_chosen(tmp_path: Path) -> None:
    told: list[str] = []

    def progress(stage: str, done: int, total: int) -> bool:
        told.append(stage)
        return told.count("pairs") == 3

    settings = FrontEndSettings(SETTINGS.features, "retrieval")
    with pytest.raises(KeyboardInterrupt, match="stopped in pairs, 0 of 1 done"):
        graph_of(write_set(tmp_path, 3), settings=settings, progress=progress)
    assert told.count("pairs") == 3


def test_a_cache_that_cannot_be_written_is_named_and_costs_no_photo(tmp_path: Path) -> None:
    photos, cache = write_set(tmp_path / "photos", 2), tmp_path / "cache"
    graph_of(photos, cache)
    for entry in (cache / "features").iterdir():
        entry.unlink()
        entry.mkdir()
    with pytest.raises(DatasetError, match="features"):
        graph_of(photos, cache)


def test_every_stage_tells_its_progress_and_its_time(tmp_path: Path) -> None:
    told: list[tuple[str, int, int]] = []
    seconds = {"features": 100.0}
    begin = time.perf_counter()
    graph_of(write_set(tmp_path, 2), seconds=seconds, progress=lambda *all: bool(told.append(all)))  # type: ignore[func-returns-value]
    elapsed = time.perf_counter() - begin
    assert told == [
        ("features", 0, 2), ("features", 1, 2), ("features", 2, 2), ("pairs", 0, 1), ("pairs", 1, 1),
        ("matching", 0, 1), ("matching", 1, 1), ("geometry", 0, 1), ("geometry", 1, 1),
    ]  # fmt: skip
    assert list(seconds) == ["features", "pairs", "matching", "geometry"]
    assert seconds["features"] > 100
    assert min(seconds.values()) > 0
    assert sum(seconds.values()) - 100 < elapsed


def test_photos_that_cannot_be_decoded_are_left_out_with_their_reasons(tmp_path: Path) -> None:
    folder = write_set(tmp_path / "photos", 3)
    cut_short(write_photo(folder / "0a.jpg", SCENE))
    (folder / "text.png").write_text("no image")
    row = np.array([300.0, 1, 125, 120, 0, 0, 0, 0, 0, 0, 0, 0])
    graph = graph_of(folder, intrinsics=[row, 2 * row, row, row])
    assert [photo.name for photo in graph.photos] == ["0.png", "1.png", "2.png"]
    assert len(graph.features) == 3
    assert sorted(graph.unreadable) == ["0a.jpg", "text.png"]
    assert "truncated" in graph.unreadable["0a.jpg"]
    # Rows go with their photos.
    del folder
    assert_same(graph, graph_of(write_set(tmp_path / "good", 3), intrinsics=[row, row, row]))


def test_an_unreadable_mask_is_named(tmp_path: Path) -> None:
    write_set(tmp_path / "photos", 2)
    write_photo(tmp_path / "masks/0.png", 255 - 0 * SCENE[:, :250])
    found = open_photos(tmp_path / "photos", masks=tmp_path / "masks")
    cut_short(tmp_path / "masks/0.png")
    graph = build_match_graph(found, SETTINGS)
    assert [photo.name for photo in graph.photos] == ["1.png"]
    assert "masks/0.png: cannot be decoded" in graph.unreadable["0.png"]


def test_a_set_without_a_photo_that_can_be_decoded_is_refused(tmp_path: Path) -> None:
    cut_short(write_photo(tmp_path / "a.jpg", SCENE))
    with pytest.raises(DatasetError, match=r"none of its 1 images can be read; a\.jpg: .*truncated"):
        graph_of(tmp_path)


def test_one_photo_has_no_pairs(tmp_path: Path) -> None:
    graph = graph_of(write_set(tmp_path, 1))
    assert (len(graph.photos), graph.pairs) == (1, [])


def test_intrinsics_of_another_number_of_photos_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidArgument, match="intrinsics: 1 rows, must be 2"):
        graph_of(write_set(tmp_path, 2), intrinsics=[None])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"ratio": 1.5}, "ratio = 1.5"),
        ({"threshold_px": 0.0}, "threshold_px = 0"),
        ({"min_inliers": 5}, "min_inliers = 5"),
        ({"seed": -1}, "seed = -1"),
        ({"threads": 0}, "threads = 0"),
    ],
)
def test_settings_out_of_range_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidArgument, match=message):
        FrontEndSettings(**changes)
