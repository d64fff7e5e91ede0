"""Rendered photos: what is where in them, what hides what, and what their files tell."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sensors import east_north_up
from sfmcpp.sources.synthetic.image_geometry import UP, ImageGeometry, distort, looking_at
from sfmcpp.sources.synthetic.photos import PLACES, WORLD_ORIGIN, render_photos
from sfmcpp.sources.synthetic.photos.faces import GREY, Face, Painter, Texture, noise_texture, plain_texture
from sfmcpp.sources.synthetic.photos.rendering import Eye
from sfmcpp.sources.vision import open_photos, read_color

SIZE = (160, 120)


def camera_at(*centre: float) -> FloatArray:
    """A camera that looks at the origin."""
    return looking_at(np.array([centre]), np.zeros(3), UP)[0]


def patch(centre: FloatArray, camera: FloatArray, half_m: float, texture: Texture) -> Face:
    """A square, parallel to the image of a camera."""
    right, down = camera[:, 0], camera[:, 1]
    corner = centre - half_m * (right + down)
    return Face(corner, 2 * half_m * right, 2 * half_m * down, texture, GREY)


def spot() -> Texture:
    """A bright spot without edges on black."""
    bell = np.exp(-((np.arange(64) - 31.5) ** 2) / 200)
    return Texture.of((255 * np.outer(bell, bell)).astype(np.float32))


@pytest.mark.parametrize("distortion", [(0.0, 0.0), (-0.15, 0.05), (0.1, 0.0)])
def test_a_patch_is_seen_where_the_camera_model_projects_it(distortion: tuple[float, float]) -> None:
    geometry = ImageGeometry("perspective", 140.0, SIZE, distortion)
    camera = camera_at(3.0, -4.0, 1.0)
    points = np.array([[0.0, 0.0, 0.0], [1.2, 0.9, 0.8], [-1.2, -0.8, -0.9], [0.8, 0.9, -1.0]])
    eye = Eye(geometry)
    for point in points:
        (_, pixel) = geometry.project(camera, point[None])
        black = patch(2 * camera[:, 2], camera, 9.0, plain_texture(0.0))
        grey = eye.picture([patch(point, camera, 0.2, spot()), black], camera)
        y, x = np.mgrid[: SIZE[1], : SIZE[0]] + 0.5
        weight = grey[:, :, 0] / grey[:, :, 0].sum()
        assert np.allclose([(x * weight).sum(), (y * weight).sum()], pixel[0], atol=0.05)


@pytest.mark.parametrize("distortion", [(-0.2, 0.05), (0.3, -0.05), (1.186, -1.0947)])
def test_rays_end_in_their_pixels_however_the_lens_folds_beyond_the_image(
    distortion: tuple[float, float],
) -> None:
    geometry = ImageGeometry("perspective", 42.05, (64, 48), distortion)
    eye = Eye(geometry)
    tangents = np.stack([eye._x.ravel(), eye._y.ravel()], axis=1).astype(np.float64)
    pixels = geometry.focal_px * distort(tangents, distortion) + geometry.principal_point_px
    down, across = np.indices(eye._x.shape)
    expected = (np.stack([across.ravel(), down.ravel()], axis=1) + 0.5) / 2
    np.testing.assert_allclose(pixels, expected, rtol=0, atol=1e-4)


def test_the_nearer_face_hides_the_other_and_backs_are_not_seen() -> None:
    camera = camera_at(0.0, -5.0, 0.0)
    near = patch(np.zeros(3), camera, 1.0, plain_texture(200.0))
    far = patch(np.array([0.0, 3.0, 0.0]), camera, 4.0, plain_texture(50.0))
    eye = Eye(ImageGeometry("perspective", 140.0, SIZE))
    for faces in ([near, far], [far, near]):
        grey = eye.picture(faces, camera)[:, :, 0]
        assert (grey[60, 80], grey[60, 30]) == (200.0, 50.0)
    back = Face(near.corner, near.down, near.along, near.texture)
    assert eye.picture([back, far], camera)[60, 80, 0] == 50.0


def test_a_texture_seen_from_afar_keeps_its_mean_and_loses_its_detail() -> None:
    texture = noise_texture((256, 256), np.random.default_rng(0))
    u, v = np.random.default_rng(1).uniform(0.2, 0.8, (2, 500)).astype(np.float32)
    fine = texture.at(u, v, np.full(500, 1.0, dtype=np.float32))
    coarse = texture.at(u, v, np.full(500, 64.0, dtype=np.float32))
    assert coarse.std() < 0.6 * fine.std()
    assert abs(coarse.mean() - fine.mean()) < 10


def test_texels_lie_where_their_coordinates_say() -> None:
    painted = noise_texture((64, 32), np.random.default_rng(0))
    texels = painted.texels[: 64 * 32].reshape(32, 64)
    rows, columns = np.array([0, 5, 31]), np.array([0, 40, 63])
    u, v = ((columns + 0.5) / 64).astype(np.float32), ((rows + 0.5) / 32).astype(np.float32)
    assert np.allclose(painted.at(u, v, np.ones(3, dtype=np.float32)), texels[rows, columns], atol=1e-3)


def test_a_box_is_seen_from_every_side() -> None:
    faces = Painter(np.random.default_rng(0), 0.1).box((-1, -1, 0), (1, 1, 2))
    eye = Eye(ImageGeometry("perspective", 140.0, SIZE))
    sky = eye.picture([], camera_at(5.0, 5.0, 3.0))
    for centre in ((5, 1, 1), (-5, 1, 1), (1, 5, 1), (1, -5, 1), (0.1, 0, 7)):
        camera = camera_at(*centre)
        assert (np.abs(eye.picture(faces, camera) - sky)[60, 80] > 0).any()
    assert len(faces) == 5


def test_same_seed_same_files_and_another_seed_others(tmp_path: Path) -> None:
    for folder, seed in (("a", 4), ("b", 4), ("c", 5)):
        render_photos("courtyard", tmp_path / folder, num_images=2, image_size=SIZE, seed=seed)
    for name in ("0000.jpg", "0001.jpg"):
        first, second, other = ((tmp_path / folder / name).read_bytes() for folder in "abc")
        assert first == second != other


def test_the_files_tell_focal_length_and_place(tmp_path: Path) -> None:
    truth = render_photos(
        "drone",
        tmp_path,
        num_images=5,
        image_size=SIZE,
        focal_px=151.3,
        exif_focal=True,
        gps_sigma_m=1.0,
        gps_outliers=2,
        suffix=".png",
    )
    photos = open_photos(tmp_path).photos
    assert [photo.name for photo in photos] == truth.metadata.image_names
    assert np.allclose([photo.focal_px for photo in photos], 151.3, rtol=1e-6)  # type: ignore[arg-type]
    told = east_north_up(np.array([photo.position for photo in photos]), WORLD_ORIGIN)
    assert np.allclose(told, truth.metadata.extra["gps"], atol=0.01)
    off = np.linalg.norm(told - truth.cameras[:, :, 3], axis=1)
    wrong = [name in truth.metadata.extra["gps_outliers"] for name in truth.metadata.image_names]
    assert sum(wrong) == 2
    assert ((off > 10) == wrong).all()


def test_all_photos_are_one_where_they_should_be(tmp_path: Path) -> None:
    render_photos("identical", tmp_path, num_images=3, image_size=SIZE)
    files = sorted(tmp_path.iterdir())
    assert len({file.read_bytes() for file in files}) == 1


@pytest.mark.parametrize("name", sorted(set(PLACES) - {"identical"}))
def test_photos_of_a_place_show_something_and_differ(name: str, tmp_path: Path) -> None:
    truth = render_photos(name, tmp_path, num_images=3, image_size=SIZE)
    photos = [read_color(photo).astype(float) for photo in open_photos(tmp_path).photos]
    assert len(photos) == truth.num_cameras == 3
    for photo, other in zip(photos, np.roll(photos, 1, axis=0), strict=True):
        assert photo.std() > 20
        assert np.abs(photo - other).mean() > 10


@pytest.mark.parametrize(
    "options",
    [
        {"num_images": 0},
        {"suffix": ".gif"},
        {"noise": -1},
        {"gps_sigma_m": 1, "gps_outliers": 9},
        {"gps_outliers": 1},
        {"focal_px": 0.0},
        {"seed": -1},
    ],
)
def test_what_makes_no_sense_is_refused(options: dict[str, float], tmp_path: Path) -> None:
    with pytest.raises(InvalidArgument):
        render_photos("planar", tmp_path, **{"num_images": 2, **options})  # type: ignore[arg-type]
    with pytest.raises(InvalidArgument, match="name = 'moon'"):
        render_photos("moon", tmp_path)
