"""Reconstruction with refined observations and without, against the true poses of rendered photos."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sfmcpp.sfm import reconstruct
from sfmcpp.sources.synthetic.photos import render_photos
from sfmcpp.study.evaluation import evaluate_model

for extra in ("cv2", "PIL", "poselib"):
    pytest.importorskip(extra, reason=f"{extra} is not installed: pip install 'sfmcpp[vision]'")


def test_refined_observations_bring_a_reconstruction_nearer_to_the_truth(tmp_path: Path) -> None:
    truth = render_photos("planar", tmp_path, num_images=6, image_size=(320, 240), suffix=".png", seed=2)
    camera = truth.intrinsics[0]
    plain = reconstruct(tmp_path, camera=camera, gps="none", subpixel=False)
    refined = reconstruct(plain.graph, camera=camera, gps="none")
    assert "refining" not in plain.seconds
    assert "refining" in refined.seconds
    assert plain.options["subpixel"] is False
    assert refined.options["subpixel"] is True
    assert plain.model is not None
    assert refined.model is not None
    before, after = evaluate_model(plain.model, truth), evaluate_model(refined.model, truth)
    assert len(before.names) == len(after.names) == 6
    assert after.centre_errors.mean() < before.centre_errors.mean() / 2
    assert after.rotation_errors_deg.mean() < before.rotation_errors_deg.mean() / 2
    found = np.concatenate([some.pixels for some in plain.graph.features])
    assert (plain.model.keypoints == found).all()


def test_a_stop_while_refining_leaves_the_model_as_it_was(tmp_path: Path) -> None:
    truth = render_photos("planar", tmp_path, num_images=4, image_size=(240, 180), suffix=".png", seed=2)
    plain = reconstruct(tmp_path, camera=truth.intrinsics[0], gps="none", subpixel=False)
    stopped = reconstruct(
        plain.graph, camera=truth.intrinsics[0], gps="none", progress=lambda stage, *_: stage == "refining"
    )
    assert stopped.interrupted
    assert plain.model is not None
    assert stopped.model is not None
    assert stopped.model.poses.tobytes() == plain.model.poses.tobytes()
