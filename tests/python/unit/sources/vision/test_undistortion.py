"""Photos without distortion and their model, against OpenCV's own mapping and exact projections."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import sfmcpp
from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.model import Problem
from sfmcpp.model.camera_models import PERSPECTIVE
from sfmcpp.model.metadata import Metadata
from sfmcpp.sources.vision import open_photos, read_color, undistort_photos
from sfmcpp.sources.vision.undistortion import undistorted_cameras
from textured_photos import texture, write_photo

cv2 = pytest.importorskip("cv2", reason="OpenCV is not installed: pip install 'sfmcpp[vision]'")
pytest.importorskip("PIL.Image", reason="Pillow is not installed: pip install 'sfmcpp[vision]'")

SIZE = (192, 128)
BARREL = {"k1": -0.2, "k2": 0.04, "p1": 2e-3, "p2": -1e-3}
PINCUSHION = {"k1": 0.15}
NAMES = ["a.png", "b/c.jpg"]


def model(lens: dict[str, float], names: list[str] | None = None) -> Problem:
    """Two cameras with that lens and exact pixels of points in front of them."""
    row = np.zeros(len(PERSPECTIVE))
    given = {"f": 150.0, "aspect": 1.05, "cx": 98.0, "cy": 62.5} | lens
    row[[PERSPECTIVE.index(name) for name in given]] = list(given.values())
    cameras = np.tile(np.eye(3, 4), (2, 1, 1))
    cameras[1, 0, 3] = 0.2
    points = np.random.default_rng(0).uniform([-0.8, -0.5, 3], [0.8, 0.5, 5], (40, 3))
    camera_index, point_index = np.divmod(np.arange(80), 40)
    sizes = np.tile(np.array(SIZE), (2, 1))
    metadata = Metadata(image_names=NAMES if names is None else names, image_sizes=sizes)
    problem = Problem(
        "perspective",
        cameras,
        row[None],
        points,
        camera_index,
        point_index,
        np.zeros((80, 2)),
        intrinsics_index=np.zeros(2, dtype=np.int32),
        metadata=metadata,
    )
    return replace(problem, pixels=-sfmcpp.residuals(problem))


@pytest.fixture
def photos(tmp_path: Path) -> Path:
    smooth = cv2.GaussianBlur(texture(*SIZE[::-1]), (0, 0), 2.0)
    for name in NAMES:
        write_photo(tmp_path / "photos" / name, smooth)
    return tmp_path / "photos"


def matrix(f: float, aspect: float, cx: float, cy: float) -> np.ndarray:
    """K as OpenCV has it, pixels counted from the centre of the first one."""
    return np.array([[f, 0, cx - 0.5], [0, aspect * f, cy - 0.5], [0, 0, 1]])


@pytest.mark.parametrize("lens", [BARREL, PINCUSHION, {}])
def test_images_are_those_of_opencv_and_the_model_fits_them(
    lens: dict[str, float], photos: Path, tmp_path: Path
) -> None:
    made = undistort_photos(model(lens), photos, tmp_path / "out")
    f, aspect, cx, cy, skew = made.intrinsics[0]
    width, height = np.asarray(made.metadata.image_sizes)[0]
    assert (f, aspect, skew) == (150.0, 1.05, 0.0)
    assert (cx, cy) == (width / 2, height / 2)
    assert np.abs(sfmcpp.residuals(made)).max() < 1e-6
    coefficients = [lens.get(name, 0.0) for name in ("k1", "k2", "p1", "p2")]
    given = matrix(150.0, 1.05, 98.0, 62.5)
    new = matrix(f, aspect, cx, cy)
    maps = cv2.initUndistortRectifyMap(
        given, np.array(coefficients), None, new, (int(width), int(height)), cv2.CV_32FC1
    )
    before, after = (
        {photo.name: read_color(photo) for photo in open_photos(folder).photos}
        for folder in (photos, tmp_path / "out/images")
    )
    assert list(after) == NAMES
    for name, levels in ((NAMES[0], 1), (NAMES[1], 6)):  # the second is a JPEG
        expected = cv2.remap(before[name], *maps, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        assert np.abs(after[name].astype(int) - expected.astype(int)).max() <= levels


@pytest.mark.parametrize("lens", [BARREL, PINCUSHION, {}])
def test_images_are_the_largest_without_a_blank_pixel(lens: dict[str, float]) -> None:
    problem = model(lens)
    cameras = undistorted_cameras(problem, np.tile(np.array(SIZE), (2, 1)))
    size, pinhole = cameras.sizes[0], cameras.pinholes[0]

    def inside(grown: float) -> bool:
        """Whether the photo shows all of the border of an image so many pixels larger on each side."""
        along = np.linspace(0, 1, 200)
        corners = [(0 * along, along), (0 * along + 1, along), (along, 0 * along), (along, 0 * along + 1)]
        border = np.concatenate([np.stack(side, axis=1) for side in corners])
        places = border * (size + 2 * grown) - grown
        rays = (places - pinhole[2:4]) / (pinhole[0] * np.array([1.0, pinhole[1]]))
        at_one = np.column_stack([rays, np.ones(len(rays))])
        seen = Problem(
            "perspective",
            np.eye(3, 4)[None],
            problem.intrinsics,
            at_one,
            np.zeros(len(rays), dtype=np.int32),
            np.arange(len(rays)),
            np.zeros((len(rays), 2)),
        )
        pixels = -sfmcpp.residuals(seen)
        return bool((pixels > -0.01).all() and (pixels < np.array(SIZE) + 0.01).all())

    assert inside(0.0)
    assert not inside(1.5)


def test_the_model_that_is_written_is_read_as_colmap_with_pinholes(photos: Path, tmp_path: Path) -> None:
    made = undistort_photos(model(BARREL), photos, tmp_path / "out")
    read = sfmcpp.read(tmp_path / "out/sparse/0")
    assert read.metadata.image_names == NAMES
    assert np.abs(sfmcpp.residuals(read)).max() < 1e-6
    np.testing.assert_array_equal(read.metadata.image_sizes, made.metadata.image_sizes)
    assert not np.delete(read.intrinsics, [0, 1, 2, 3], axis=1).any()


def test_the_same_bytes_for_any_number_of_threads(photos: Path, tmp_path: Path) -> None:
    for threads in (1, 2):
        undistort_photos(model(BARREL), photos, tmp_path / f"{threads}", threads=threads)
    files = [sorted(p for p in (tmp_path / f"{n}").rglob("*") if p.is_file()) for n in (1, 2)]
    assert [p.read_bytes() for p in files[0]] == [p.read_bytes() for p in files[1]]


def test_what_cannot_be_is_refused_by_name(photos: Path, tmp_path: Path) -> None:
    problem, out = model(BARREL), tmp_path / "out"
    with pytest.raises(DatasetError, match=r"1 of 2 photos of the model are missing, the first is 'd\.png'"):
        undistort_photos(model(BARREL, ["a.png", "d.png"]), photos, out)
    with pytest.raises(InvalidArgument, match=r"two cameras have the photo 'a\.png'"):
        undistort_photos(model(BARREL, ["a.png", "a.png"]), photos, out)
    with pytest.raises(InvalidArgument, match="0 names of photos for 2 cameras"):
        undistort_photos(model(BARREL, []), photos, out)
    with pytest.raises(InvalidArgument, match=r"has the photos in images: must be another one"):
        undistort_photos(problem, photos.rename(tmp_path / "images"), tmp_path)
    write_photo(tmp_path / "images/a.png", texture(64, 64))
    with pytest.raises(DatasetError, match=r"a\.png: has 64×64 pixels, in the model 192×128"):
        undistort_photos(problem, tmp_path / "images", out)
    problem.intrinsics[0, PERSPECTIVE.index("cx")] = 300.0
    with pytest.raises(InvalidArgument, match=r"principal point \(300, 62\.5\) px: must be inside the photo"):
        undistorted_cameras(problem, np.tile(np.array(SIZE), (2, 1)))
    bal = sfmcpp.circle_scene(4, 20, camera_model="bal")
    with pytest.raises(InvalidArgument, match="camera_model = 'bal'"):
        undistorted_cameras(bal, np.tile(np.array(SIZE), (4, 1)))
    assert not out.exists()


def test_a_run_that_is_stopped_leaves_no_model_of_an_earlier_one(photos: Path, tmp_path: Path) -> None:
    undistort_photos(model(BARREL), photos, tmp_path / "out")
    with pytest.raises(KeyboardInterrupt):
        undistort_photos(
            model(PINCUSHION), photos, tmp_path / "out", progress=lambda stage, done, total: done > 0
        )
    assert list((tmp_path / "out/sparse/0").iterdir()) == []


def write_levels(path: Path, levels: np.ndarray) -> None:
    """A file of blue, green, red and opacity, by OpenCV."""
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), levels)


@pytest.mark.parametrize("suffix", ["png", "tif", "ppm"])
def test_photos_of_16_bits_keep_them(tmp_path: Path, suffix: str) -> None:
    """Against OpenCV's own map; levels between those of 8 bits must be there, and dark ones not brighter."""
    rng = np.random.default_rng(0)
    levels = cv2.GaussianBlur(rng.integers(0, 4096, (128, 192, 3)).astype(np.uint16), (0, 0), 3.0)
    names = [f"a.{suffix}", f"b.{suffix}"]
    for name in names:
        write_levels(tmp_path / "photos" / name, levels)
    result = undistort_photos(model(BARREL, names), tmp_path / "photos", tmp_path / "out")
    made = cv2.imread(str(tmp_path / "out" / "images" / names[0]), cv2.IMREAD_UNCHANGED)
    assert made.dtype == np.uint16
    pinhole = matrix(*result.intrinsics[0][:4])
    lens = np.array([BARREL[key] for key in ("k1", "k2", "p1", "p2")])
    size = made.shape[1::-1]
    maps = cv2.initUndistortRectifyMap(
        matrix(150.0, 1.05, 98.0, 62.5), lens, None, pinhole, size, cv2.CV_32FC1
    )
    expected = cv2.remap(levels, *maps, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    assert np.abs(made.astype(int) - expected.astype(int)).max() <= 2


def test_grey_photos_of_16_bits_keep_them(tmp_path: Path) -> None:
    levels = np.full((128, 192), 300, dtype=np.uint16)
    for name in ("a.png", "b.png"):
        write_levels(tmp_path / "photos" / name, levels)
    undistort_photos(model(BARREL, ["a.png", "b.png"]), tmp_path / "photos", tmp_path / "out")
    made = cv2.imread(str(tmp_path / "out" / "images" / "a.png"), cv2.IMREAD_UNCHANGED)
    assert made.dtype == np.uint16
    assert (made == 300).all()


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_transparent_parts_stay_transparent(tmp_path: Path, dtype: type) -> None:
    levels = np.full((128, 192, 4), 200, dtype=dtype)
    levels[:, :96, 3], levels[:, 96:, 3] = 0, np.iinfo(dtype).max
    for name in ("a.png", "b.png"):
        write_levels(tmp_path / "photos" / name, levels)
    undistort_photos(model({}, ["a.png", "b.png"]), tmp_path / "photos", tmp_path / "out")
    made = cv2.imread(str(tmp_path / "out" / "images" / "a.png"), cv2.IMREAD_UNCHANGED)
    assert made.dtype == dtype
    assert (made[:, :, :3] == 200).all()
    assert (made[:, :80, 3] == 0).all()
    assert (made[:, 110:, 3] == np.iinfo(dtype).max).all()


def test_kinds_of_files_without_room_have_8_bits(tmp_path: Path) -> None:
    """A PNG of 16 bits whose name says JPEG becomes a JPEG."""
    levels = np.full((128, 192, 4), 32768, dtype=np.uint16)
    for name in ("a.jpg", "b.jpg"):
        path = tmp_path / "photos" / name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(cv2.imencode(".png", levels)[1].tobytes())
    undistort_photos(model({}, ["a.jpg", "b.jpg"]), tmp_path / "photos", tmp_path / "out")
    made = cv2.imread(str(tmp_path / "out" / "images" / "a.jpg"), cv2.IMREAD_UNCHANGED)
    assert made.shape[2] == 3
    assert (np.abs(made.astype(int) - 128) <= 1).all()


def write_told(path: Path, mode: str = "RGB", **told: object) -> None:
    """A photo with what a phone tells: model, orientation, time, sizes, focal lengths, notes and position."""
    from PIL import Image

    exif = Image.Exif()
    exif.update({0x0110: "Phone", 0x0112: 6})
    exif.get_ifd(0x8769).update({0x9003: "2026:11:28 10:00:00", 0x920A: 4.25, 0xA405: 26, 0x927C: b"notes"})
    exif.get_ifd(0x8769).update({0xA002: SIZE[0], 0xA003: SIZE[1]})
    exif.get_ifd(0x8825).update({1: "N", 2: (47.0, 30.0, 0.0), 3: "E", 4: (8.0, 15.0, 0.0)})
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(texture(*SIZE[::-1])).convert(mode).save(path, **({"exif": exif} | told))


def profile(space: bytes) -> bytes:
    """As much of a colour profile as is looked at (ICC.1: bytes 16 to 19), in two segments of a JPEG."""
    return bytes(16) + space + bytes(range(256)) * 300


@pytest.mark.parametrize("suffix", ["jpg", "jfif", "png", "webp"])
def test_colour_profile_and_exif_are_kept(tmp_path: Path, suffix: str) -> None:
    from PIL import Image

    names = [f"a.{suffix}", f"b.{suffix}"]
    write_told(tmp_path / "photos" / names[0], icc_profile=profile(b"RGB "))
    write_told(tmp_path / "photos" / names[1], exif=b"")
    undistort_photos(model(BARREL, names), tmp_path / "photos", tmp_path / "out")
    with Image.open(tmp_path / "out/images" / names[0]) as made:
        exif = made.getexif()
        found, gps = exif.get_ifd(0x8769), exif.get_ifd(0x8825)
        assert made.info["icc_profile"] == profile(b"RGB ")
        assert dict(exif).keys() == {0x0110, 0x8769, 0x8825}
        assert found == {0x9003: "2026:11:28 10:00:00", 0x920A: 4.25, 0xA002: made.width, 0xA003: made.height}
        assert gps == {1: "N", 2: (47.0, 30.0, 0.0), 3: "E", 4: (8.0, 15.0, 0.0)}
    # Colours are those of a photo without either, which OpenCV writes.
    pair = [read_color(photo).astype(int) for photo in open_photos(tmp_path / "out/images").photos]
    assert np.abs(pair[0] - pair[1]).mean() < 0.5
    with Image.open(tmp_path / "out/images" / names[1]) as made:
        assert "icc_profile" not in made.info
        assert not made.getexif()


def test_profiles_of_other_colours_are_left_out(tmp_path: Path) -> None:
    """Of grey photos and of those for print: the images have red, green and blue."""
    from PIL import Image

    for name, mode, space in (("a.jpg", "L", b"GRAY"), ("b.jpg", "CMYK", b"CMYK")):
        write_told(tmp_path / "photos" / name, mode, icc_profile=profile(space))
    undistort_photos(model({}, ["a.jpg", "b.jpg"]), tmp_path / "photos", tmp_path / "out")
    for name in ("a.jpg", "b.jpg"):
        with Image.open(tmp_path / "out/images" / name) as made:
            assert made.mode == "RGB"
            assert "icc_profile" not in made.info
            assert made.getexif()[0x0110] == "Phone"


def test_damaged_exif_costs_no_image(tmp_path: Path) -> None:
    for name in ("a.jpg", "b.jpg"):
        write_told(tmp_path / "photos" / name, exif=b"Exif\0\0II*\0\xff\xff\xff\xff" + bytes(40))
    undistort_photos(model({}, ["a.jpg", "b.jpg"]), tmp_path / "photos", tmp_path / "out")
    assert len(open_photos(tmp_path / "out/images").photos) == 2
