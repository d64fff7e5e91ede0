"""Cameras that are those of a COLMAP database, so that COLMAP can go on with the model and the database."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sfmcpp.sfm.cameras import PERSPECTIVE, Cameras
from sfmcpp.sources.io.colmap.camera_models import MODELS
from sfmcpp.sources.io.colmap.database import DatabaseCamera


def as_in_database(cameras: Cameras, known: Sequence[DatabaseCamera], *, keep_models: bool) -> Cameras:
    """Give cameras the identifiers of those of a database, and their models.

    Parameters
    ----------
    cameras : Cameras
        Made for images of the database.
    known : sequence of DatabaseCamera
        Camera of each image in the database.
    keep_models : bool
        Whether their parameters are estimated, and no others. The focal lengths stay those of `cameras`.

    Returns
    -------
    Cameras
        The same ones where images share cameras otherwise than in the database.
    """
    count = len(cameras.intrinsics)
    of_camera = {int(g): camera for g, camera in zip(cameras.of_image, known, strict=True)}
    shared = {(int(g), camera.id) for g, camera in zip(cameras.of_image, known, strict=True)}
    ids = [of_camera[g].id for g in range(count)]
    if len(shared) > count or len(set(ids)) < count:
        return cameras
    numbered = replace(cameras, ids=np.array(ids, dtype=np.int64))
    if not keep_models:
        return numbered
    models = [of_camera[g].model for g in range(count)]
    rows = np.array([of_camera[g].intrinsics for g in range(count)])
    rows[:, 0] = cameras.intrinsics[:, 0]
    fixed = np.array([[name not in MODELS[model].free for name in PERSPECTIVE] for model in models])
    return replace(numbered, intrinsics=rows, fixed=fixed, names=models, model_is_open=False)
