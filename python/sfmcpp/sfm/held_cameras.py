"""Warnings of calibrations that were given and that the images of a model contradict."""

from __future__ import annotations

from collections.abc import Sequence

from sfmcpp.doctor.calibration import calibration
from sfmcpp.doctor.case import Case
from sfmcpp.doctor.distortion import distortion
from sfmcpp.map import Map
from sfmcpp.sfm.cameras import PERSPECTIVE, Cameras


def held_camera_warnings(models: Sequence[Map], cameras: Cameras) -> list[str]:
    """Let the doctor try other calibrations where focal lengths were given to stay.

    Parameters
    ----------
    models : sequence of Map
        Adjusted.
    cameras : Cameras
        What was given.

    Returns
    -------
    list of str
        A sentence for each contradiction; nothing where a focal length is estimated.
    """
    if not cameras.fixed[:, PERSPECTIVE.index("f")].all():
        return []
    warnings = []
    for world in models:
        case = Case(world.whole_problem(2).problem, [], None)
        for examine in (distortion, calibration):
            warnings += [f"the camera as given: {f.what}" for f in examine(case) if f.severity == "warning"]
    return warnings
