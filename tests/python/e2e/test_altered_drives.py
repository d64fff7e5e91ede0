"""Drives as they might have been: what is seen and measured belongs to the way that is driven."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from sfmcpp.geometry import relative_pose, so3
from sfmcpp.sources.io.kitti_mat import KittiDrive, read_kitti_mat
from sfmcpp.study.evaluation import evaluate

BENCH = Path(__file__).resolve().parents[3] / "bench"
NAMES = ["stops", "backwards", "half-rate", "lost-frames", "half-the-tracks", "noisy"]


@pytest.fixture
def module(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], ModuleType]:
    monkeypatch.syspath_prepend(str(BENCH))
    return importlib.import_module


@pytest.fixture
def drive(data_dir: Path) -> KittiDrive:
    return read_kitti_mat(data_dir / "kitti_tracks/2011_09_26_drive_0001_sync_KLT.mat")


@pytest.mark.parametrize("name", NAMES)
def test_the_streams_integrated_are_as_good_as_before(
    name: str, drive: KittiDrive, module: Callable[[str], ModuleType]
) -> None:
    altered = module("experiments.altered_drives").ALTERED[name](drive)
    integrated = module("experiments.inputs").dead_reckoning
    errors = [
        evaluate(integrated(one), one.truth, with_scale=False).mean_3d_error_m for one in (drive, altered)
    ]
    assert errors[1] < 1.3 * errors[0]
    way = [
        np.linalg.norm(np.diff(one.truth.poses[:, :, 3], axis=0), axis=1).sum() for one in (drive, altered)
    ]
    assert way[1] == pytest.approx(way[0], rel=0.02)


@pytest.mark.parametrize("name", NAMES)
def test_images_turn_as_the_truth_does(
    name: str, drive: KittiDrive, module: Callable[[str], ModuleType]
) -> None:
    altered = module("experiments.altered_drives").ALTERED[name](drive)
    order = np.lexsort([altered.track_index, altered.frame_index])
    np.testing.assert_array_equal(order, np.arange(len(order)))
    errors = []
    for k in range(0, len(altered.t_s) - 4, 10):
        views = [altered.frame_index == k, altered.frame_index == k + 4]
        _, here, there = np.intersect1d(*(altered.track_index[v] for v in views), return_indices=True)
        if len(here) < 30:
            continue
        pixels = [altered.left_px[v][rows] for v, rows in zip(views, (here, there), strict=True)]
        found = relative_pose(*pixels, altered.intrinsics, seed=0)
        true = altered.truth.poses[k][:, :3].T @ altered.truth.poses[k + 4][:, :3]
        if found.failure in ("", "ambiguous", "rotation only"):
            errors.append(np.degrees(so3.rotation_angle(true.T @ found.camera[:, :3])))
    assert len(errors) >= 2
    assert np.median(errors) < 0.3


def test_the_vehicle_stands_where_it_stops(drive: KittiDrive, module: Callable[[str], ModuleType]) -> None:
    altered = module("experiments.altered_drives").ALTERED["stops"](drive)
    step_s = float(np.median(np.diff(drive.t_s)))
    speeds = np.linalg.norm(np.diff(altered.truth.poses[:, :, 3], axis=0), axis=1) / step_s
    assert np.count_nonzero(speeds < 0.01) * step_s == pytest.approx(8.0, abs=1.0)
    # Over a second: stamps of single frames jitter.
    smooth = np.convolve(speeds, np.ones(10) / 10, "valid")
    assert np.abs(smooth[10:] - smooth[:-10]).max() / (10 * step_s) < 6.0
