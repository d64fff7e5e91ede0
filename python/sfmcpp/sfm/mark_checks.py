"""Marks of ground control points that are far from where the model has their points.

Such marks bend the model before anything shows in the offsets of the points, which follow them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from sfmcpp.ba import residuals_px
from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray, IndexArray
from sfmcpp.model.image_tracks import first_beyond_images

# Marks set by hand were 1 to 4 times as far off as keypoints; those of photos of 1.1 times the size 20 times.
_TIMES_KEYPOINTS = 6.0
# Of normal errors none in a million is so many medians off.
_TIMES_MEDIAN = 8.0
# Pixels so far outside of their image, in its larger side, are none of it.
_MARGIN = 0.1
# What is closer is no mistake, however good all else is [px].
_LEAST_PX = 0.5


def warnings_about_marks(
    problem: Problem, num_marks: int, points: Sequence[str], images: Sequence[str]
) -> Iterator[str]:
    """Name marks that do not show the points they are of.

    Parameters
    ----------
    problem : Problem
        Adjusted together with the marks, its last observations, of its last points.
    num_marks : int
        How many these are.
    points : sequence of str
        Names of its last points.
    images : sequence of str
        Names of the images of all cameras.

    Yields
    ------
    str
        A sentence on all marks, if most are far off; else one on the worst, if that is.
    """
    errors_px = np.linalg.norm(residuals_px(problem), axis=1)
    keypoints, marks = errors_px[:-num_marks], errors_px[-num_marks:]
    usual = float(np.median(marks))
    of_keypoints = float(np.median(keypoints)) if len(keypoints) else np.inf
    if usual > _TIMES_KEYPOINTS * max(of_keypoints, _LEAST_PX):
        yield (
            f"the marks are {usual:.3g} px from where the model has their points (median; keypoints "
            f"{of_keypoints:.2g} px): are they of images of another size, or of other images, with u and v "
            "from the upper left corner?"
        )
        return
    bad = _far(marks, usual)
    if len(bad):
        row = problem.num_observations - num_marks + int(bad[0])
        point = points[int(problem.point_index[row]) - problem.num_points + len(points)]
        image = images[int(problem.camera_index[row])]
        more = f"; {len(bad) - 1} more marks are far off" if len(bad) > 1 else ""
        yield (
            f"the mark of {point!r} in {image!r} is {marks[bad[0]]:.3g} px from where the model has it, half "
            f"of all marks less than {usual:.2g} px: a wrong mark, which bends the model, or one of another "
            f"point{more}"
        )


def mark_outside(problem: Problem, cameras: IndexArray, pixels: FloatArray) -> tuple[int, str] | None:
    """Place and fault of the first mark that is of no image, or far outside of its own; or None.

    Parameters
    ----------
    problem : Problem
        The model; its metadata may know the sizes of images.
    cameras : (k,) int32
        Camera of each mark.
    pixels : (k, 2) float64
        Where [px].

    Returns
    -------
    int, str or None
    """
    fault = first_beyond_images(pixels)
    if fault is not None:
        return fault[0] // 2, fault[1]
    sizes = problem.metadata.image_sizes
    if not isinstance(sizes, np.ndarray) or sizes.shape != (problem.num_cameras, 2):
        return None
    size = sizes[cameras].astype(np.float64)
    margin = _MARGIN * size.max(axis=1, initial=0.0, keepdims=True)
    inside = ((pixels > -margin) & (pixels < size + margin)).all(axis=1) | (size <= 0).any(axis=1)
    if inside.all():
        return None
    worst = int(np.argmin(inside))
    (u, v), (width, height) = pixels[worst].tolist(), sizes[cameras[worst]].tolist()
    rule = "must be in it: are the marks of photos of another size?"
    return worst, f"{u:g}, {v:g} px is far outside of the image of {width} × {height} px: {rule}"


def _far(errors_px: FloatArray, usual_px: float) -> FloatArray:
    """Numbers of marks that are far off, the worst first."""
    order = np.argsort(-errors_px, kind="stable")
    return np.asarray(order[errors_px[order] > _TIMES_MEDIAN * max(usual_px, _LEAST_PX)])
