"""Starts as batch structure from motion leaves them before any adjustment (thesis algorithm 4)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from experiments.description import Experiment, ExperimentError, Row
from experiments.real_problems import data_folder
from experiments.starts import Start
from sfmcpp import Problem
from sfmcpp.model.image_tracks import ImageTracks, image_tracks
from sfmcpp.sfm.batch.projective import reconstruct_projective
from sfmcpp.sfm.batch.upgrade import MetricUpgrade, metric_upgrade
from sfmcpp.sources.io.image_tracks import read_image_tracks
from sfmcpp.sources.io.kitti_mat import read_kitti_mat


def factorised_starts(experiment: Experiment) -> Iterator[Start]:
    """Each set of ``settings.factorised`` in the camera models of the experiment: calibrated, projective.

    A set has a `name`, a `file`, the `size` of its images, and, as it needs them, how many consecutive
    `images` (those that see most), the `first` of them and the `step` between them, known `intrinsics`, and
    the `principal_point`. With `settled` the projective reconstruction is adjusted, the metric one is not.
    It may have `camera_models` of its own.
    """
    for item in experiment.settings.get("factorised", []):
        tracks = _tracks(item)
        found = reconstruct_projective(tracks, adjusted=item.get("settled", False), threads=1)
        if found.problem is None:
            raise ExperimentError(f"{item['name']}: {found.message}")
        for model in item.get("camera_models", experiment.camera_models):
            problem = found.problem if model == "projective" else _calibrated(item, tracks, found.problem)
            yield Start(item["name"], 0, problem)


def _tracks(item: Row) -> ImageTracks:
    """The tracks of a set that at least two of its images see."""
    path = data_folder() / item["file"]
    whole = _of_drive(item) if path.suffix == ".mat" else read_image_tracks(path)
    count, step = item.get("images", whole.num_images), item.get("step", 1)
    first = item.get("first", _richest(whole, count))
    images = first + step * np.arange(count)
    kept = np.isin(whole.image_index, images)
    _, tracks, views = np.unique(whole.track_index[kept], return_inverse=True, return_counts=True)
    seen = views[tracks] > 1
    return image_tracks(
        np.searchsorted(images, whole.image_index[kept][seen]),
        np.unique(tracks[seen], return_inverse=True)[1],
        whole.pixels[kept][seen],
        sizes=np.tile(item["size"], (count, 1)),
    )


def _richest(tracks: ImageTracks, count: int) -> int:
    """The first of so many consecutive images that see most."""
    seen = np.bincount(tracks.image_index, minlength=tracks.num_images)
    return int(np.argmax(np.convolve(seen, np.ones(count), mode="valid")))


def _of_drive(item: Row) -> ImageTracks:
    drive = read_kitti_mat(data_folder() / item["file"])
    item.setdefault("intrinsics", drive.intrinsics.tolist())
    return image_tracks(drive.frame_index, drive.track_index, drive.left_px)


def _calibrated(item: Row, tracks: ImageTracks, start: Problem) -> Problem:
    """The metric upgrade with known intrinsics, or with those that an adjusted one finds."""
    intrinsics = item.get("intrinsics")
    if intrinsics is None:
        whole = reconstruct_projective(tracks, threads=1).problem
        assert whole is not None
        centre = {"principal_point": item["principal_point"]} if "principal_point" in item else {}
        adjusted = _upgraded(item, metric_upgrade(whole, item["size"], threads=1, **centre))
        intrinsics = adjusted.intrinsics[0, :5]
    found = metric_upgrade(
        start, item["size"], focal="known", intrinsics=intrinsics, adjusted=False, threads=1
    )
    problem = _upgraded(item, found)
    return replace(
        problem, camera_model="calibrated", intrinsics=problem.intrinsics[:, :5], fixed_intrinsics=None
    )


def _upgraded(item: Row, found: MetricUpgrade) -> Problem:
    if found.problem is None:
        raise ExperimentError(f"{item['name']}: {found.reason}")
    return found.problem
