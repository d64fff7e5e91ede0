"""Features lie where the blobs and corners of a photo are, and are the same in every run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.model.photos import Features
from sfmcpp.sources.vision import FEATURE_KINDS, FeatureSettings, detect, detect_in, open_photos
from textured_photos import blobs, cut_short, texture, write_photo

cv2 = pytest.importorskip("cv2", reason="OpenCV is not installed: pip install 'sfmcpp[vision]'")
Image = pytest.importorskip("PIL.Image", reason="Pillow is not installed: pip install 'sfmcpp[vision]'")

COLUMNS = ("pixels", "scales", "angles", "colors", "descriptors")
# Not on a grid of pixels, and on both sides of where tiles meet.
CENTRES = np.array([[x + 0.1 * (x % 7), y + 0.13 * (y % 5)] for x in range(60, 1240, 93) for y in (77, 150)])


def nearest(centres: NDArray[np.float64], found: Features) -> tuple[NDArray[Any], NDArray[Any]]:
    """Offset to the nearest feature of each centre, and its number."""
    offsets = found.pixels[None] - centres[:, None]
    numbers = np.linalg.norm(offsets, axis=2).argmin(axis=1)
    return offsets[np.arange(len(centres)), numbers], numbers


def assert_same(one: Features, other: Features) -> None:
    for name in COLUMNS:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


@pytest.mark.parametrize("sigma", [1.6, 3.0, 4.5, 9.0])
def test_blobs_are_found_at_their_centres_with_their_size(sigma: float) -> None:
    found = detect_in(blobs(230, 1300, CENTRES, sigma))
    offsets, numbers = nearest(CENTRES, found)
    # Rounded grey levels move a blob by hundredths of its size.
    assert np.abs(offsets).max() < 0.02 * max(sigma, 2.5)
    assert np.abs(offsets.mean(axis=0)).max() < 0.01 * max(sigma, 2.5)
    # The blur that answers most to a blob is as wide as it is.
    np.testing.assert_allclose(found.scales[numbers], sigma, rtol=0.15)


def test_a_photo_that_is_shrunk_keeps_places_and_sizes() -> None:
    picture = blobs(460, 1300, CENTRES, 6.0)
    found = detect_in(picture, settings=FeatureSettings(max_size_px=480))
    offsets, numbers = nearest(CENTRES, found)
    assert np.abs(offsets).max() < 0.2
    assert np.abs(offsets.mean(axis=0)).max() < 0.05
    np.testing.assert_allclose(found.scales[numbers], 6.0, rtol=0.15)


@pytest.mark.parametrize("kind", ["harris", "shi-tomasi"])
def test_corners_of_squares_are_found_where_they_are(kind: str) -> None:
    picture = np.full((200, 300, 3), 60, np.uint8)
    for x in (50, 120, 190):
        picture[60:110, x : x + 40] = 200
    corners = np.array([[x + a, y] for x in (50, 120, 190) for a in (0, 40) for y in (60, 110)], dtype=float)
    found = detect_in(picture, settings=FeatureSettings(kind))
    offsets, _ = nearest(corners, found)
    assert len(found) == len(corners)
    assert np.abs(offsets).max() < 0.1


@pytest.mark.parametrize("kind", FEATURE_KINDS)
def test_the_same_places_look_alike_in_a_turned_photo(kind: str) -> None:
    picture = texture(240, 320, seed=3)
    turned = np.ascontiguousarray(np.rot90(picture))
    settings = FeatureSettings(kind, max_features=400)
    one, other = detect_in(picture, settings=settings), detect_in(turned, settings=settings)
    back = np.column_stack([320 - other.pixels[:, 1], other.pixels[:, 0]])
    distance = np.linalg.norm(one.descriptors[:, None].astype(float) - other.descriptors[None], axis=2)
    best = distance.argmin(axis=1)
    two = np.partition(distance, 1, axis=1)[:, :2]
    clear = two[:, 0] < 0.8 * two[:, 1]
    error = np.linalg.norm(one.pixels - back[best], axis=1)[clear]
    assert clear.sum() > 100
    assert (error < 1).mean() > 0.95
    turn = (other.angles[best] - one.angles)[clear][error < 1]
    # Counterclockwise on the screen is from y towards x.
    assert np.median(np.abs(np.angle(np.exp(1j * (turn + np.pi / 2))))) < 0.1


@pytest.mark.parametrize("kind", FEATURE_KINDS)
def test_features_are_the_same_whatever_the_number_of_threads(kind: str) -> None:
    picture, settings = texture(700, 1300, seed=5), FeatureSettings(kind, max_features=1500)
    before = cv2.getNumThreads()
    try:
        cv2.setNumThreads(1)
        alone = detect_in(picture, settings=settings)
        cv2.setNumThreads(3)
        together = detect_in(picture, settings=settings)
    finally:
        cv2.setNumThreads(before)
    assert len(alone) == 1500
    assert_same(alone, together)


def test_no_feature_is_lost_or_doubled_where_tiles_meet() -> None:
    picture = texture(300, 1500, seed=6)
    found = detect_in(picture, settings=FeatureSettings(max_features=100_000))
    whole = cv2.SIFT_create(0, 3, 0.0133, 10, 1.6, enable_precise_upscale=True).detect(
        cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), None
    )
    fine = np.array([k.pt for k in whole if (k.octave & 255) in (255, 0)]) + 0.5
    # Where one tile ends and the next begins; blobs of the others come from a smaller image.
    near = np.abs(fine[:, 0] - 750) < 40
    distance = np.linalg.norm(fine[near][:, None] - found.pixels[None], axis=2)
    assert near.sum() > 100
    assert np.quantile(distance.min(axis=1), 0.98) < 0.02
    seen = found.scales < 3.3
    ours = seen & (np.abs(found.pixels[:, 0] - 750) < 40)
    assert abs(int(ours.sum()) - int(near.sum())) <= 0.02 * near.sum()


@pytest.mark.parametrize("kind", FEATURE_KINDS)
def test_nothing_is_detected_where_a_mask_is_black(kind: str) -> None:
    picture = texture(300, 400, seed=7)
    mask = np.zeros((300, 400), np.bool_)
    mask[100:, 150:] = True
    for settings in (FeatureSettings(kind), FeatureSettings(kind, max_size_px=200)):
        found = detect_in(picture, mask, settings)
        assert len(found) > 50
        slack = 400 / settings.max_size_px
        assert (found.pixels >= np.array([150, 100]) - slack).all()
    assert len(detect_in(picture, np.zeros((300, 400), np.bool_), FeatureSettings(kind))) == 0


@pytest.mark.parametrize("kind", FEATURE_KINDS)
def test_no_more_than_wanted_are_kept_and_all_parts_of_the_photo_have_some(kind: str) -> None:
    picture = texture(480, 640, seed=8)
    # Little contrast on the left: its features are all weaker than those on the right.
    picture[:, :320] = 128 + (picture[:, :320].astype(int) - 128) // 3
    found = detect_in(picture, settings=FeatureSettings(kind, max_features=300))
    assert len(found) == 300
    # Half of the features are spread over 5 × 4 cells, of which 2 × 4 lie wholly on the left: a fifth of all.
    assert (found.pixels[:, 0] < 320).mean() > 0.15


@pytest.mark.parametrize("kind", FEATURE_KINDS)
@pytest.mark.parametrize("count", [1, 2, 3])
def test_very_few_features_can_be_asked_for(kind: str, count: int) -> None:
    picture = texture(200, 300, seed=3)
    assert len(detect_in(picture, settings=FeatureSettings(kind, max_features=count))) == count


@pytest.mark.parametrize("kind", FEATURE_KINDS)
def test_a_photo_without_texture_has_no_features(kind: str) -> None:
    found = detect_in(np.full((70, 90, 3), 128, np.uint8), settings=FeatureSettings(kind))
    shapes = [getattr(found, name).shape for name in COLUMNS]
    assert shapes == [(0, 2), (0,), (0,), (0, 3), (0, 128)]
    assert found.descriptors.dtype == np.uint8


@pytest.mark.parametrize("kind", FEATURE_KINDS)
@pytest.mark.parametrize("size", [(1, 1), (3, 200), (17, 17)])
def test_tiny_photos_do_no_harm(kind: str, size: tuple[int, int]) -> None:
    picture = np.random.default_rng(2).integers(0, 256, (*size, 3), np.uint8)
    found = detect_in(picture, settings=FeatureSettings(kind))
    assert ((found.pixels >= 0) & (found.pixels <= size[::-1])).all()


def test_descriptors_are_roots_of_unit_sum() -> None:
    found = detect_in(texture(200, 300))
    norms = np.linalg.norm(found.descriptors.astype(float), axis=1)
    np.testing.assert_allclose(norms, 512, rtol=0.01)


def test_colours_are_those_of_the_pixel_below_each_feature() -> None:
    picture = texture(200, 300)
    picture[:, :, 0] = np.arange(300) % 256
    found = detect_in(picture)
    columns, rows = np.floor(found.pixels).astype(int).T
    np.testing.assert_array_equal(found.colors, picture[rows, columns])


@pytest.mark.parametrize(
    ("color", "mask", "message"),
    [
        (np.zeros((40, 60), np.uint8), None, r"color: uint8 \(40, 60\), must be uint8 \(height, width, 3\)"),
        (np.zeros((40, 60, 3)), None, r"color: float64 \(40, 60, 3\)"),
        (np.zeros((0, 60, 3), np.uint8), None, r"color: uint8 \(0, 60, 3\)"),
        (texture(40, 60), np.ones((40, 60), np.uint8), r"mask: uint8 \(40, 60\), must be bool \(40, 60\)"),
        (texture(40, 60), np.ones((80, 60), np.bool_), r"mask: bool \(80, 60\), must be bool \(40, 60\)"),
    ],
)
@pytest.mark.parametrize("kind", FEATURE_KINDS)
def test_pixels_and_masks_of_another_kind_are_refused(
    kind: str, color: NDArray[Any], mask: NDArray[Any] | None, message: str
) -> None:
    with pytest.raises(InvalidArgument, match=message):
        detect_in(color, mask, FeatureSettings(kind))


def test_a_file_gives_what_its_pixels_and_mask_give(tmp_path: Path) -> None:
    picture, mask = texture(200, 300), np.zeros((200, 300, 3), np.uint8)
    mask[:, 100:] = 255
    write_photo(tmp_path / "photos/a.png", picture)
    write_photo(tmp_path / "masks/a.png", mask)
    (photo,) = open_photos(tmp_path / "photos", masks=tmp_path / "masks").photos
    assert_same(detect(photo), detect_in(picture, mask[:, :, 0] > 0))


@pytest.mark.parametrize(("left", "right", "masked"), [(0, 1, True), (0, 0, False), (255, 255, False)])
def test_nothing_is_detected_where_a_photo_is_transparent_unless_all_of_it_is(
    tmp_path: Path, left: int, right: int, masked: bool
) -> None:
    picture, light = texture(200, 300), np.zeros((200, 300), np.bool_)
    light[:, 100:] = True
    alpha = np.where(light, right, left).astype(np.uint8)
    Image.fromarray(np.dstack([picture, alpha])).save(tmp_path / "a.png")
    (photo,) = open_photos(tmp_path).photos
    assert_same(detect(photo), detect_in(picture, light if masked else None))


def test_a_mask_holds_for_a_transparent_photo_too(tmp_path: Path) -> None:
    picture = texture(200, 300)
    (tmp_path / "photos").mkdir()
    Image.fromarray(np.dstack([picture, np.eye(200, 300, dtype=np.uint8)])).save(tmp_path / "photos/a.png")
    write_photo(tmp_path / "masks/a.png", np.full_like(picture, 255))
    (photo,) = open_photos(tmp_path / "photos", masks=tmp_path / "masks").photos
    assert_same(detect(photo), detect_in(picture))


def test_a_truncated_photo_is_named_and_not_filled_with_grey(tmp_path: Path) -> None:
    cut_short(write_photo(tmp_path / "a.jpg", texture(200, 300)))
    (photo,) = open_photos(tmp_path).photos
    with pytest.raises(DatasetError, match=r"a\.jpg: cannot be decoded: .*truncated"):
        detect(photo)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"kind": "surf"}, "kind = 'surf': must be one of sift, harris, shi-tomasi"),
        ({"max_features": 0}, "max_features = 0"),
        ({"max_size_px": 10}, "max_size_px = 10"),
        ({"contrast": 0.0}, "contrast = 0"),
        ({"quality": 1.0}, "quality = 1"),
    ],
)
def test_settings_out_of_range_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidArgument, match=message):
        FeatureSettings(**changes)


def truth(file: Path) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """K, world_from_camera rotation and centre of a file of Strecha's benchmark."""
    numbers = np.array(file.read_text().split(), dtype=float)
    return numbers[:9].reshape(3, 3), numbers[12:21].reshape(3, 3), numbers[21:24]


def fundamental(one: Path, other: Path) -> NDArray[Any]:
    (k1, r1, c1), (k2, r2, c2) = truth(one), truth(other)
    x, y, z = r1.T @ (c2 - c1)
    essential = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ r1.T @ r2
    return np.asarray(np.linalg.inv(k1).T @ essential @ np.linalg.inv(k2))


def alike(one: Features, other: Features) -> NDArray[np.int64]:
    """Mutually nearest descriptors that pass the ratio test, by all distances."""
    a, b = one.descriptors.astype(np.float32), other.descriptors.astype(np.float32)
    squared = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1) - 2 * a @ b.T
    best = squared.argmin(axis=1)
    two = np.partition(squared, 1, axis=1)[:, :2]
    mutual = squared.argmin(axis=0)[best] == np.arange(len(a))
    kept = np.flatnonzero(mutual & (two[:, 0] < 0.64 * two[:, 1]))
    return np.column_stack([kept, best[kept]])


@pytest.mark.real
@pytest.mark.parametrize(("kind", "fewest", "median_px"), [("sift", 800, 0.2), ("shi-tomasi", 300, 0.3)])
@pytest.mark.parametrize("scene", ["fountain_p11", "herz_jesus_p8"])
def test_matches_of_real_photos_lie_on_the_true_epipolar_lines(
    data_dir: Path, scene: str, kind: str, fewest: int, median_px: float
) -> None:
    photos = open_photos(data_dir / scene / "images").photos[3:5]
    # Half the size for speed: errors in its pixels.
    settings = FeatureSettings(kind, max_features=4000, max_size_px=1536)
    one, other = (detect(photo, settings) for photo in photos)
    matches = alike(one, other)
    cameras = [data_dir / scene / "gt_dense_cameras" / f"{photo.name}.camera" for photo in photos]
    p = np.column_stack([one.pixels, np.ones(len(one))])[matches[:, 0]]
    q = np.column_stack([other.pixels, np.ones(len(other))])[matches[:, 1]]
    f = fundamental(*cameras)
    lines = q @ f.T, p @ f
    slopes = sum((line[:, :2] ** 2).sum(axis=1) for line in lines)
    error = np.abs((p * lines[0]).sum(axis=1)) / np.sqrt(slopes) / 2
    good = error < 1
    assert good.sum() > fewest
    assert good.mean() > 0.9
    assert np.median(error[good]) < median_px
