"""KITTI drives by number, parts of them, and drives with a blackout."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from experiments.altered_drives import ALTERED, STREAMS, rows_of
from experiments.drive_names import CLIP, SIMULATED
from experiments.other_motions import simulated
from experiments.real_problems import data_folder
from sfmcpp.model import SensorStream, Trajectory
from sfmcpp.sources.image_stream import open_images
from sfmcpp.sources.io.kitti_mat import KittiDrive, read_kitti_mat


@cache
def read(name: str) -> KittiDrive:
    """Read a drive by its number, or ``clip``; ``0036:1/2`` is a part, ``0036@stops`` an altered drive.

    ``simulated/u-turn`` is one of `other_motions`.
    """
    if name.startswith(SIMULATED):
        return simulated(name.removeprefix(SIMULATED))
    name, _, change = name.partition("@")
    if change:
        return ALTERED[change](read(name))
    name, _, part = name.partition(":")
    if part:
        return _part(read(name), *map(int, part.split("/")))
    if name == CLIP:
        return _clip()
    (file,) = sorted((data_folder() / "kitti_tracks").glob(f"*_drive_{name}_*.mat"))
    return read_kitti_mat(file)


def _part(whole: KittiDrive, number: int, parts: int) -> KittiDrive:
    """Part `number`, from 1, of `parts` equal ones; its streams begin with it and last to the end."""
    begin, end = (len(whole.t_s) * k // parts for k in (number - 1, number))
    kept = (whole.frame_index >= begin) & (whole.frame_index < end)
    truth, first_s = whole.truth, whole.t_s[begin]
    streams = {name: _from(getattr(whole, name), first_s) for name in STREAMS}
    some = rows_of(whole, np.flatnonzero(kept))
    return replace(
        some,
        t_s=whole.t_s[begin:end],
        frame_index=some.frame_index - np.int32(begin),
        truth=Trajectory(truth.t_s[begin:end], truth.poses[begin:end]),
        **streams,
    )


def _from(stream: SensorStream, first_s: float) -> SensorStream:
    kept = stream.t_s >= first_s
    return SensorStream(stream.t_s[kept], stream.values[kept], stream.kind, stream.name)


def _clip() -> KittiDrive:
    """The first frames of 0020, with tracks made from their images; no right image.

    Its truth is its own: the poses of 0020 begin at 10.5 m/s where odometer, images and these have 11.5.
    """
    whole = read("0020")
    truth = np.loadtxt(data_folder() / "kitti_clip/poses.txt").reshape(-1, 3, 4)
    images, _ = open_images(data_folder() / "kitti_clip/image_l")
    views = [frame.view for frame in images]
    kept = slice(0, len(views))
    pixels = np.concatenate([view.pixels for view in views])
    return replace(
        whole,
        t_s=whole.t_s[kept],
        frame_index=np.repeat(np.arange(len(views), dtype=np.int32), [len(view.tracks) for view in views]),
        track_index=np.concatenate([view.tracks for view in views]).astype(np.int32),
        left_px=pixels,
        right_px=np.full_like(pixels, np.nan),
        truth=Trajectory(whole.t_s[kept], truth),
    )


def with_blackout(drive: KittiDrive, seconds: float) -> KittiDrive:
    """Take away the observations of so many seconds in the middle; no track continues across them."""
    if not seconds:
        return drive
    middle, t_s = drive.t_s[len(drive.t_s) // 2], drive.t_s[drive.frame_index]
    tracks = drive.track_index + np.where(t_s > middle, drive.num_tracks, 0).astype(np.int32)
    return rows_of(replace(drive, track_index=tracks), np.flatnonzero(np.abs(t_s - middle) > seconds / 2))
