"""Tracks whose pixels count from the middle of the image, as those of BAL, Bundler and NVM files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import sfmcpp
from cloud_views import FOCAL_PX, views_of_cloud
from sfmcpp.model.image_tracks import ImageTracks, image_tracks
from sfmcpp.sfm import reconstruct
from sfmcpp.sfm.imported_tracks import from_corner

SIZE = np.array([1001, 750])
NOISE_PX = 0.2


def tracks(centred: bool, sizes_known: bool) -> ImageTracks:
    """What five cameras see of a cloud."""
    image, track, pixels = views_of_cloud(SIZE, NOISE_PX)
    origin = SIZE / 2 if centred else np.zeros(2)
    sizes = [SIZE] * 5 if sizes_known else None
    return image_tracks(image, track, pixels - origin, sizes=sizes, centred=centred)


def test_pixels_from_the_middle_become_pixels_from_the_corner() -> None:
    moved, wanted = from_corner(tracks(centred=True, sizes_known=True)), tracks(False, True)
    np.testing.assert_allclose(moved.pixels, wanted.pixels, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(moved.centres, wanted.centres)
    unknown = from_corner(tracks(centred=True, sizes_known=False))
    assert (unknown.centres == unknown.sizes / 2).all()
    assert (unknown.pixels >= 0).all()
    assert (unknown.pixels.max(axis=0) <= unknown.sizes[0]).all()
    assert from_corner(wanted) is wanted


@pytest.mark.parametrize("sizes_known", [False, True])
def test_a_model_of_them_has_its_principal_point_in_the_middle_of_its_images(
    tmp_path: Path, sizes_known: bool
) -> None:
    problem = reconstruct(tracks(True, sizes_known), shared_camera="one").problem(0)
    sfmcpp.write(problem, tmp_path / "model", format="colmap-text")
    sfmcpp.write(problem, tmp_path / "transforms.json")
    for name in ("model", "transforms.json"):
        written = sfmcpp.read(tmp_path / name)
        assert written.metadata.image_sizes is not None
        np.testing.assert_allclose(written.intrinsics[:, 2:4], written.metadata.image_sizes[:1] / 2)
    assert (sfmcpp.read(tmp_path / "model").pixels >= 0).all()


def test_a_camera_that_is_given_counts_from_the_corner() -> None:
    camera = (FOCAL_PX, 1.0, *(SIZE / 2), 0.0)
    found = [reconstruct(tracks(centred, True), camera=camera).problem(0) for centred in (False, True)]
    assert [problem.num_cameras for problem in found] == [5, 5]
    np.testing.assert_allclose(found[1].pixels, found[0].pixels, rtol=0, atol=1e-6)
