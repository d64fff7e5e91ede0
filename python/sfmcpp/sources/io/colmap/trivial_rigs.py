"""Rigs of one camera each, which COLMAP writes with every model: kept where a model is replaced."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from sfmcpp.errors import DatasetError
from sfmcpp.sources.io.colmap.rig_files import CAMERA, Frame, Rig, RigModel, Sensor
from sfmcpp.sources.io.colmap.tables import ImageTable, Tables
from sfmcpp.sources.io.files import is_present


def trivial_rigs_in(
    folder: Path, names: Sequence[str], read: Callable[..., RigModel | None], *, has_model: bool
) -> RigModel | None:
    """Rigs and frames in the files of these names; None if there are none.

    Parameters
    ----------
    folder : Path
        Of the model that is to be replaced.
    names : sequence of str
        Of the files of rigs and frames.
    read : callable
        Reads them.
    has_model : bool
        Whether the folder has the model that they belong to.

    Raises
    ------
    DatasetError
        If they are anything but rigs of one camera each: a new model would contradict them.
    """
    there = [folder / name for name in names if is_present(folder / name)]
    if not there:
        return None
    found = None
    if has_model and len(there) == len(names):
        try:
            found = read(folder, alone=True)
        except DatasetError:  # what cannot be read is not replaced
            found = None
    kinds = {sensor.kind for rig in found.rigs for sensor in rig.sensors} if found else set()
    if found is None or kinds != {CAMERA} or any(len(frame.data) != 1 for frame in found.frames):
        reason = "the model that is there would be replaced, and this file would contradict the new poses"
        raise DatasetError(there[-1], f"{reason}; write to another folder")
    return found


def with_poses_of(tables: Tables, known: RigModel) -> RigModel:
    """A rig for each camera and a frame for each image, with the identifiers of `known` if it fits.

    Without, rigs have those of their cameras and frames those of their images, as COLMAP numbers them.
    """
    rig_of_camera = {sensor.id: rig.id for rig in known.rigs for sensor in rig.sensors}
    frame_of_image = {image: frame.id for frame in known.frames for _, _, image in frame.data}
    cameras, images = tables.cameras.ids.tolist(), tables.images.ids.tolist()
    if not (rig_of_camera.keys() >= set(cameras) and frame_of_image.keys() >= set(images)):
        rig_of_camera, frame_of_image = ({number: number for number in ids} for ids in (cameras, images))
    rigs = [Rig(rig_of_camera[camera], (Sensor(CAMERA, camera),)) for camera in cameras]
    frames = [
        Frame(frame_of_image[image], rig_of_camera[camera], tuple(pose), ((CAMERA, camera, image),))
        for image, camera, pose in _images(tables.images)
    ]
    return RigModel(tuple(rigs), tuple(frames), known.rigs_path, known.frames_path)


def _images(images: ImageTable) -> zip[tuple[int, int, list[float]]]:
    poses = np.concatenate([images.quaternions, images.translations], axis=1)
    return zip(images.ids.tolist(), images.camera_ids.tolist(), poses.tolist(), strict=True)
