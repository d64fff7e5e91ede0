"""Images taken along the way that the camera looks leave focal length and distortion open."""

from __future__ import annotations

import numpy as np
import pytest

import sfmcpp.sfm.adjustment as adjustment
from cloud_views import views_of_cloud
from sfmcpp import circle_scene
from sfmcpp.model.image_tracks import ImageTracks, image_tracks
from sfmcpp.sfm import reconstruct
from sfmcpp.sfm.structure import are_in_cameras

SIZE, FOCAL_PX, COUNT, POINTS = np.array([620, 188]), 359.0, 10, 500
NOISE_PX, NEAR_M, FAR_M = 2.0, 2.0, 24.0


def drive_along_walls(seed: int) -> ImageTracks:
    """What a camera sees of two walls that goes a metre between images, straight ahead."""
    rng = np.random.default_rng(seed)
    side = rng.choice([-1, 1], POINTS)
    depth = rng.uniform(3, 33 + COUNT, POINTS)
    across, down = rng.uniform(3, 9, POINTS), rng.uniform(-3, 1.6, POINTS)
    points = np.column_stack([side * across, down, depth])
    images, tracks, pixels = [], [], []
    for image in range(COUNT):
        ahead = points[:, 2] - image
        seen = FOCAL_PX * points[:, :2] / ahead[:, None] + SIZE / 2
        seen += rng.normal(0, NOISE_PX, seen.shape)
        inside = (ahead > NEAR_M) & (ahead < FAR_M) & (seen > 0).all(axis=1) & (seen < SIZE).all(axis=1)
        images.append(np.full(np.count_nonzero(inside), image))
        tracks.append(np.flatnonzero(inside))
        pixels.append(seen[inside])
    return image_tracks(*map(np.concatenate, (images, tracks, pixels)), sizes=[SIZE] * COUNT, centred=False)


@pytest.mark.parametrize("seed", [6, 7])
def test_the_model_has_all_images_and_a_lens_that_can_be(seed: int) -> None:
    """Of seed 6 k1 was 56,266,188, beside 744 px; seed 7 ended with "observations: there are none"."""
    run = reconstruct(drive_along_walls(seed), shared_camera="one")
    assert run.num_registered == COUNT
    assert run.model is not None
    focal, k1 = run.model.intrinsics[0, [0, 5]]
    assert 0.3 * FOCAL_PX < focal < 3 * FOCAL_PX
    # A lens moves corners by a fraction of their distance from the middle.
    assert abs(k1) * (np.hypot(*SIZE) / 2 / focal) ** 2 < 1
    assert any("not determine the focal length" in warning for warning in run.warnings)


@pytest.mark.parametrize("most", [0.0, 2.0])
def test_a_distortion_that_no_lens_has_is_none_and_told(most: float, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(adjustment, "_MOST_MOVED", most)
    size = np.array([1000, 750])
    tracks = image_tracks(*views_of_cloud(size, 0.5), sizes=[size] * 5, centred=False)
    run = reconstruct(tracks, shared_camera="one")
    assert run.model is not None
    assert (run.model.intrinsics[0, 5] == 0) == (most == 0)
    assert any("beside the distortion" in warning for warning in run.warnings) == (most == 0)


def test_points_at_a_camera_that_sees_them_are_told() -> None:
    scene = circle_scene(4, 12, camera_model="perspective", seed=0)
    assert not are_in_cameras(scene).any()
    seen = scene.point_index[scene.camera_index == 2][3]
    scene.points[seen] = scene.cameras[2, :, 3] + 1e-9 * scene.cameras[2, :, 2]
    assert np.flatnonzero(are_in_cameras(scene)).tolist() == [seen]
    assert not are_in_cameras(scene.with_observations(np.zeros(0, dtype=np.int64))).any()
