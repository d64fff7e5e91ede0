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
