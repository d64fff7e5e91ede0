"""Positions that are wrong as a whole: of the images before or after, or with a σ in another unit."""

from __future__ import annotations

import re

import numpy as np
import pytest

from flights import flight, in_a_frame_of_its_own
from sfmcpp.errors import InvalidArgument
from sfmcpp.model import Problem
from sfmcpp.model.photos import Photo
from sfmcpp.sensors import geodetic_of
from sfmcpp.sensors.gps import earth_centred
from sfmcpp.sfm import georeference
from sfmcpp.sfm.georeference import georeference_to
from sfmcpp.sfm.position_checks import undecidable_positions, worst_deviation
from sfmcpp.sfm.positions import Positions, choose_positions, local_positions, unused_positions
from sfmcpp.sources.io.named_positions import NamedPositions
from sfmcpp.weighting.conflict import OUTLIER_SIGMAS

SIGMA_M = 0.3


def strips() -> Problem:
    """Three strips there and back."""
    along = np.arange(6) * 12.0
    rows = [np.column_stack([a, np.full(6, 15.0 * k)]) for k, a in enumerate((along, along[::-1], along))]
    return flight(np.concatenate(rows), seed=2)


def warnings_of(shift: int = 0, wrong: int = 0, stated_m: float = SIGMA_M) -> str:
    truth = strips()
    random = np.random.default_rng(6)
    gps = np.roll(truth.centres, -shift, axis=0) + random.normal(0, SIGMA_M, truth.centres.shape)
    gps[3 : 3 + wrong] += random.uniform(20, 40, (wrong, 3))
    sigmas = np.full(gps.shape, stated_m)
    found = georeference(in_a_frame_of_its_own(truth, 2), gps, sigmas_m=sigmas)
    return "\n".join(found.outcome.warnings)


@pytest.mark.parametrize(
    ("parts_of_a_degree", "told"),
    [
        (1e4, "rounded to 0.0001°, 11 m"),
        (6000, "rounded to 0.01 minutes, 19 m"),
        (3600, "rounded to whole seconds, 31 m"),
        (1e5, None),
        (1e7, None),
    ],
)
def test_degrees_that_were_rounded_are_told_with_what_they_cost(
    parts_of_a_degree: float, told: str | None
) -> None:
    """Written as text, as tables have them: what their metres tell must be as good."""
    truth = strips()
    gps = geodetic_of(truth.centres, [46.84265, -91.99400, 198.0])
    degrees = np.rint(gps[:, :2] * parts_of_a_degree) / parts_of_a_degree
    gps[:, :2] = [[float(f"{number:.12f}") for number in row] for row in degrees]
    warnings = georeference(in_a_frame_of_its_own(truth, 2), gps, geodetic=True).outcome.warnings
    rounded = [warning for warning in warnings if "are rounded to" in warning]
    assert len(rounded) == (told is not None)
    assert all(told in warning for warning in rounded if told is not None)


@pytest.mark.parametrize(
    ("origin", "as_radians", "is_doubted"),
    [
        ([46.84, -91.99, 198.0], True, True),
        ([46.84, -91.99, 198.0], False, False),
        ([-0.2, 116.0, 30.0], True, True),  # in Borneo, at the equator
        ([1.2, 2.1, 3.0], False, True),  # a ship in the gulf of Guinea: nothing tells it from radians
        ([0.001, -0.002, 3.0], False, False),
    ],
)
def test_latitudes_in_radians_are_doubted(origin: list[float], as_radians: bool, is_doubted: bool) -> None:
    truth = strips()
    gps = geodetic_of(truth.centres, origin)
    gps[:, :2] = np.deg2rad(gps[:, :2]) if as_radians else gps[:, :2]
    warnings = georeference(in_a_frame_of_its_own(truth, 2), gps, geodetic=True).outcome.warnings
    assert [
        w for w in warnings if "seem to be radians: as degrees they are a small place in the sea" in w
    ] == (warnings if is_doubted else [])
    assert bool(warnings) == is_doubted


@pytest.mark.parametrize("origin", [[48.1, 11.5, 520.0], [-33.9, -70.6, 3000.0]])
def test_geocentric_positions_are_told_with_their_latitude(origin: list[float]) -> None:
    truth = strips()
    gps = earth_centred(geodetic_of(truth.centres, origin))
    (warning,) = georeference(in_a_frame_of_its_own(truth, 2), gps).outcome.warnings
    told = re.search(r"are those of (\S+)°, (\S+)° from the centre of the Earth \(geocentric", warning)
    assert told is not None
    assert [float(number) for number in told.groups()] == pytest.approx(origin[:2], abs=1e-3)


@pytest.mark.parametrize("offset", [(0.0, 0.0, 0.0), (500_000.0, 6_350_000.0, 400.0), (1e6, 2e6, -3e5)])
def test_projected_positions_are_not_taken_for_geocentric(offset: tuple[float, float, float]) -> None:
    """The second is as far from zero as the surface of the Earth from its centre."""
    truth = strips()
    warnings = georeference(in_a_frame_of_its_own(truth, 2), truth.centres + offset).outcome.warnings
    assert warnings == []


@pytest.mark.parametrize(("shift", "side"), [(1, "after"), (-1, "before")])
def test_positions_of_the_next_image_are_doubted_and_the_shift_is_named(shift: int, side: str) -> None:
    text = warnings_of(shift)
    assert "do not trust where the model is" in text
    assert f"each fits the image {side} it" in text


def test_a_shift_is_named_whatever_order_the_cameras_are_in() -> None:
    """Tables go by name; cameras of an NVM file, and of a COLMAP model of other ids, are in another order."""
    truth, random = strips(), np.random.default_rng(6)
    truth.metadata.image_names = [f"IMG_{8 + k}.jpg" for k in range(truth.num_cameras)]
    gps = np.roll(truth.centres, -1, axis=0) + random.normal(0, SIGMA_M, truth.centres.shape)
    order = random.permutation(truth.num_cameras)
    found = georeference(in_a_frame_of_its_own(truth.with_cameras(order), 2), gps[order]).outcome
    assert any("each fits the image after it" in text for text in found.warnings)


def test_a_shift_is_named_where_crossing_strips_hide_it() -> None:
    """Few positions are left out then: σ grows instead."""
    along, across = np.arange(6) * 12.0, np.arange(4) * 15.0
    rows = [np.column_stack([a, np.full(6, 15.0 * k)]) for k, a in enumerate((along, along[::-1], along))]
    columns = [np.column_stack([np.full(4, 12.0 + 24.0 * k), across[:: 1 - 2 * k]]) for k in (0, 1)]
    truth = flight(np.concatenate(rows + columns), seed=2)
    random = np.random.default_rng(6)
    gps = np.roll(truth.centres, 1, axis=0) + random.normal(0, 0.02, truth.centres.shape)
    found = georeference(in_a_frame_of_its_own(truth, 2), gps).outcome
    assert any("each fits the image before it" in text for text in found.warnings)


def warnings_of_block(seed: int, *, off: float = 0.0, heights: float = 1.0, stated: bool = True) -> list[str]:
    """Of four strips, where one position is wrong by so many σ, and heights by so much more than all else."""
    along = np.arange(7) * 12.0
    rows = [np.column_stack([along[:: (-1) ** k], np.full(7, 15.0 * k)]) for k in range(4)]
    truth = flight(np.concatenate(rows), seed)
    sigmas = 0.05 * np.tile([1.0, 1.0, heights], (28, 1))
    gps = truth.centres + np.random.default_rng([seed, 7]).normal(size=(28, 3)) * sigmas
    gps[9, 0] += off * 0.05
    found = georeference(in_a_frame_of_its_own(truth, seed), gps, sigmas_m=sigmas if stated else None)
    return found.outcome.warnings


def test_one_wrong_position_is_named_by_its_own_standard_deviation() -> None:
    (warning,) = warnings_of_block(1, off=10.0)
    assert "the position of 9 is" in warning
    assert "standard deviations" in warning
    assert "kept, but probably wrong" in warning


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(("heights", "stated"), [(2.0, True), (3.0, False)])
def test_no_right_position_is_named(seed: int, heights: float, stated: bool) -> None:
    assert not warnings_of_block(seed, heights=heights, stated=stated)


def residuals_of_stiff_images(seed: int, off: float) -> tuple[np.ndarray, np.ndarray]:
    """Residuals (14, 3) of positions of σ = 1 that images hold, too, the second one off; their hat matrix."""
    rng = np.random.default_rng(seed)
    places = rng.normal(size=(14, 3))
    shifts = np.tile(np.eye(3), (14, 1))
    turns = np.stack([np.cross(axis, places).ravel() for axis in np.eye(3)], axis=1)
    free, _ = np.linalg.qr(np.column_stack([shifts, turns, places.ravel()]))  # what images do not hold
    held = np.eye(42) - free @ free.T
    root = held @ rng.normal(size=(42, 42)) * np.sqrt(rng.uniform(0.02, 0.2))
    hat = np.linalg.inv(np.eye(42) + root @ root.T)
    errors = rng.normal(size=42)
    errors[3] += off
    return (hat @ (errors + root @ rng.normal(size=42)) - errors).reshape(14, 3), hat


def test_positions_that_images_hold_too_are_not_named_by_chance() -> None:
    alarms, hits = 0, 0
    for seed in range(200):
        alarms += worst_deviation(*weighted(residuals_of_stiff_images(seed, 0.0)))[1] > OUTLIER_SIGMAS
        worst, deviation = worst_deviation(*weighted(residuals_of_stiff_images(seed, 20.0)))
        hits += worst == 1 and deviation > OUTLIER_SIGMAS
    assert alarms <= 2
    assert hits > 150


def weighted(found: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return found[0], np.ones(found[0].shape), found[1]


def test_columns_that_seem_to_be_standard_deviations_are_named_where_none_are_read() -> None:
    truth = strips()
    known = Positions(truth.centres, unread=("X_acc", "Y_acc"))
    (warning,) = georeference_to(in_a_frame_of_its_own(truth, 2), known).outcome.warnings
    assert "the columns X_acc, Y_acc of the positions are not read: standard deviations are in" in warning


@pytest.mark.parametrize(("gps", "enough"), [("auto", True), ("exif", False), ("gps.csv", False)])
def test_too_few_positions_are_refused_before_the_work_where_they_are_asked_for(
    gps: str, enough: bool
) -> None:
    places = [(46.0, 9.0 + 0.001 * k, 100.0) for k in range(4)]
    photos = [Photo(f"{k}.jpg", None, (640, 480), position=place) for k, place in enumerate(places)]
    named = {photo.name: place for photo, place in zip(photos, places, strict=True)}
    known = NamedPositions(named, geodetic=True) if gps == "gps.csv" else None
    if enough:
        assert choose_positions(gps, known, photos) is None
        return
    with pytest.raises(InvalidArgument, match="gps: 4 images have a position, 5 are needed"):
        choose_positions(gps, known, photos)


def test_positions_without_heights_are_told_as_that() -> None:
    places = [(46.0, 9.0 + 0.001 * k, np.nan) for k in range(8)]
    photos = [Photo(f"{k}.jpg", None, (640, 480), position=place) for k, place in enumerate(places)]
    told = unused_positions("auto", photos)
    assert len(told) == 1
    assert "0 photos have one with a height, 8 without, 5 are needed" in told[0]


def test_positions_that_are_all_the_same_are_refused_as_that() -> None:
    photos = [Photo(f"{k}.jpg", None, (640, 480), position=(46.0, 9.0, 100.0)) for k in range(8)]
    with pytest.raises(InvalidArgument, match="gps: the positions are all the same"):
        choose_positions("exif", None, photos)


@pytest.mark.parametrize("gps", ["auto", "exif"])
def test_positions_on_a_line_are_refused_before_the_work_where_they_are_asked_for(gps: str) -> None:
    places = [(46.0, 9.0 + 0.001 * k, 100.0) for k in range(8)]
    photos = [Photo(f"{k}.jpg", None, (640, 480), position=place) for k, place in enumerate(places)]
    if gps == "auto":
        assert choose_positions(gps, None, photos) is not None  # which prove useless later, with a warning
        return
    with pytest.raises(InvalidArgument, match="gps: the positions lie on a line, which leaves the model"):
        choose_positions(gps, None, photos)


def test_a_few_wrong_positions_are_left_out_without_doubt_of_the_others() -> None:
    text = warnings_of(wrong=2)
    assert "2 positions disagree with the images" in text
    assert "do not trust" not in text


@pytest.mark.parametrize(
    ("stated_m", "told"),
    [(SIGMA_M, False), (SIGMA_M / 3, True), (3 * SIGMA_M, False), (300.0, True), (0.003, True)],
)
def test_a_stated_sigma_in_another_unit_is_told(stated_m: float, told: bool) -> None:
    assert (f"where {stated_m:.3g} m is stated" in warnings_of(stated_m=stated_m)) == told


@pytest.mark.parametrize(
    ("gps", "count", "told"), [("auto", 3, True), ("auto", 5, False), ("none", 3, False)]
)
def test_positions_of_files_that_are_too_few_are_named(gps: str, count: int, told: bool) -> None:
    photos = [Photo(f"{k}.jpg", size=(640, 480), position=(46.0, 9.0, 300.0)) for k in range(count)]
    assert [f"{count} photos have one, 5 are needed" in text for text in unused_positions(gps, photos)] == [
        True
    ] * told


def test_an_origin_of_zero_has_no_sign() -> None:
    assert not np.signbit(local_positions(np.full((5, 3), -30.0), geodetic=False).origin).any()


def test_an_axis_without_residuals_hides_no_wrong_position() -> None:
    apart = np.random.default_rng(0).normal(size=(12, 3))
    apart[:, 2], apart[3, 0] = 0.0, 50.0
    hat = 0.1 * np.eye(36)
    worst, deviation = worst_deviation(apart, np.ones((12, 3)), hat)
    assert worst == 3
    assert deviation > 4
    assert worst_deviation(np.zeros((12, 3)), np.ones((12, 3)), hat) == (0, 0.0)


def test_of_images_at_one_place_no_position_is_undecidable() -> None:
    metres = np.random.default_rng(0).normal(size=(6, 3))
    trusted = np.arange(6) < 5
    assert not undecidable_positions(np.ones((6, 3)), metres, np.ones((6, 3)), trusted).any()
