"""The Dinosaur of Oxford's geometry group: 36 photos from a turntable, of which only tracks are told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat
from scipy.spatial.transform import Rotation

from projective_scenes import turns_deg
from sfmcpp import projective_problem, residuals
from sfmcpp.sfm.batch.projective import reconstruct_projective
from sfmcpp.sfm.batch.upgrade import MetricUpgrade, metric_upgrade
from sfmcpp.sources.io.image_tracks import read_image_tracks


def require_turntable(result: MetricUpgrade) -> None:
    """36 cameras, each 10° after the one before, about one axis; the first after the last, too."""
    assert result.problem is not None, result.reason
    problem = result.problem
    assert len(result.cameras) == 36
    rotations = np.concatenate([problem.rotations, problem.rotations[:1]])
    turns = turns_deg(rotations)
    assert np.abs(turns - 10).max() < 0.3
    steps = rotations[1:] @ np.swapaxes(rotations[:-1], 1, 2)
    axes = Rotation.from_matrix(steps).as_rotvec() / np.radians(turns)[:, None]
    assert np.degrees(np.arccos(np.clip(axes @ axes.mean(axis=0), -1, 1))).max() < 3
    assert np.sqrt(np.mean(residuals(problem) ** 2)) < 0.25
    assert result.focal_sigma < 0.01


@pytest.mark.real
def test_it_turns_by_ten_degrees_about_one_axis(data_dir: Path) -> None:
    folder = data_dir / "dinosaur"
    tracks = read_image_tracks(folder / "viff.xy")
    cameras = np.stack(list(loadmat(folder / "dino_Ps.mat")["P"][0])).astype(np.float64)
    homography = np.random.default_rng(0).standard_normal((4, 4))
    start = projective_problem(
        cameras @ homography,
        np.ones((tracks.num_tracks, 4)),
        tracks.image_index,
        tracks.track_index,
        tracks.pixels,
    )
    require_turntable(metric_upgrade(start, (576, 720), threads=1))


@pytest.mark.real
def test_it_is_reconstructed_from_its_tracks_alone(data_dir: Path) -> None:
    pytest.importorskip("poselib", reason="fundamental matrices need the extra 'vision'")
    tracks = read_image_tracks(data_dir / "dinosaur" / "viff.xy")
    found = reconstruct_projective(tracks)
    start = found.problem
    assert start is not None
    error = np.linalg.norm(np.asarray(residuals(start)).reshape(-1, 2), axis=1)
    assert np.sqrt(np.mean(error**2)) < 0.5
    views = np.bincount(tracks.track_index)
    kept = np.bincount(found.tracks[start.point_index], minlength=len(views))
    assert (kept[views >= 3] >= 3).mean() > 0.9
    # No size is told: as far as the corners reach, 548 × 642.
    require_turntable(metric_upgrade(start, np.ceil(start.pixels.max(axis=0)), threads=1))
