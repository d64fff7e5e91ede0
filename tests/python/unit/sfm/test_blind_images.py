"""Images that see no point: nothing tells where they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import sfmcpp
from flights import in_a_frame_of_its_own
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sfm.georeference import georeference


def test_an_image_that_sees_nothing_is_not_placed_and_has_no_sigma() -> None:
    """Its position was called wrong, its centre had σ 0, and so had the focal length of its camera."""
    truth = sfmcpp.circle_scene(
        40, 300, pixel_sigma_px=0.5, radius_m=60.0, cube_m=30.0, seed=0
    ).with_shared_intrinsics(np.arange(40) % 2)
    truth = replace(
        truth, camera_model="perspective", intrinsics=padded(truth.intrinsics), fixed_intrinsics=None
    )
    truth.set_free_intrinsics("f")
    gps = truth.centres + np.random.default_rng(0).normal(0, 0.3, truth.centres.shape)
    problem = in_a_frame_of_its_own(truth.with_observations(truth.camera_index != 0), 0)
    problem.cameras[0, :, 3] += 5.0
    found = georeference(problem, gps).outcome
    assert (found.outliers, found.without_position) == ([], [])
    assert found.warnings == [
        "the position of 0 is not used: its image sees no point, which leaves open where the image is"
    ]
    assert found.sigmas_m.keys() == found.residuals_m.keys() == {str(k) for k in range(1, 40)}
    assert min(sigmas.min() for sigmas in found.sigmas_m.values()) > 0.01
    assert found.intrinsics_sigmas is not None
    one, other = found.intrinsics_sigmas[:, 0]
    assert 0.5 < one / other < 2


def padded(intrinsics: FloatArray) -> FloatArray:
    return np.pad(intrinsics, ((0, 0), (0, 12 - intrinsics.shape[1])))
