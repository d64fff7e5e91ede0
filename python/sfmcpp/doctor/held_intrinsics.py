"""Intrinsics held at values a few percent off, which residuals hardly show: poses and points absorb them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sfmcpp.doctor.case import Case
from sfmcpp.doctor.finding import Finding
from sfmcpp.doctor.freed_intrinsics import FreedIntrinsics
from sfmcpp.doctor.trial import BENDS
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.model.camera_models import PERSPECTIVE

# So many standard deviations do not come about by chance, even where they are too small by a factor.
_SIGMAS = 5.0
# Part of the image's radius that the correction moves pixels at its border by: less is of no consequence. A
# principal point is mostly taken up by rotations, and bends the scene from a larger part on than others.
_LEAST, _FAR_CENTRE = 0.003, 0.05
_CENTRE = ("cx", "cy")
_F, _K1 = PERSPECTIVE.index("f"), PERSPECTIVE.index("k1")
_CODES = {
    "f": "wrong-focal",
    "aspect": "wrong-aspect",
    "cx": "wrong-principal-point",
    "cy": "wrong-principal-point",
    "k1": "wrong-distortion",
}
_WHAT = {
    "f": "the focal length",
    "aspect": "the aspect fy / fx",
    "cx": "the principal point",
    "cy": "the principal point",
    "k1": "the distortion k1",
}


def held_intrinsics(case: Case) -> Iterator[Finding]:
    """Find held intrinsics that differ from those the images prefer by far more than their σ."""
    explained = case.blames_calibration or case.lacks_distortion or case.has_rolling_shutter
    if explained or case.freed_intrinsics is None:
        return
    freed = case.freed_intrinsics
    wrong = contradicted(case, freed)
    for places in _together(freed, wrong):
        if wrong[:, places].any():
            yield _finding(case, freed, wrong, places)


def contradicted(case: Case, freed: FreedIntrinsics) -> BoolArray:
    """(k, n) whether the images contradict the value that each intrinsic is held at.

    Where the images hardly tell a parameter, its σ by the linear model may be wrong: the squared error must
    fall as unlikely, too.
    """
    from scipy.stats import chi2, norm

    fall = case.squared_error(freed.given) - case.squared_error(freed.freed)
    least = float(chi2.isf(2 * norm.sf(_SIGMAS), freed.sigmas.size))
    change = np.abs(freed.after - freed.before)
    certain = (change > _SIGMAS * freed.sigmas) & (fall > least * freed.variance_px2)
    return np.asarray(certain & (freed.moved > _LEAST))


def _together(freed: FreedIntrinsics, wrong: BoolArray) -> list[list[int]]:
    """Places of what a finding is about: one intrinsic, or both coordinates of the principal point.

    A wrong distortion alone: what the others are estimated as depends on what is free of the lens.
    """
    names = [PERSPECTIVE[k] for k in freed.columns]
    if "k1" in names and wrong[:, names.index("k1")].any():
        return [[names.index("k1")]]
    alone = [[k] for k, name in enumerate(names) if name not in _CENTRE]
    centre = [k for k, name in enumerate(names) if name in _CENTRE]
    return [*alone, centre] if centre else alone


def _finding(case: Case, freed: FreedIntrinsics, wrong: BoolArray, places: list[int]) -> Finding:
    rows = wrong[:, places].any(axis=1)
    moved = np.where(wrong[:, places], freed.moved[:, places], 0.0).max(axis=1)
    worst = int(np.argmax(moved))
    name = PERSPECTIVE[freed.columns[places[0]]]
    before, after, sigma = (table[worst, places] for table in (freed.before, freed.after, freed.sigmas))
    concerned = np.isin(freed.freed.problem.intrinsics_index, freed.rows[rows])
    cameras = () if rows.all() else tuple(int(k) for k in np.flatnonzero(concerned))
    of = f" of camera {case.name_of_camera(int(freed.cameras[worst]))}" if cameras else ""
    limit = _FAR_CENTRE if name in _CENTRE else BENDS
    return Finding(
        "missing-distortion" if name == "k1" and not before[0] else _CODES[name],
        "warning" if moved[worst] > limit else "note",
        f"{_WHAT[name]}{of} that the images prefer is {_told(name, before, after, sigma)}; pixels at the "
        f"border move by {moved[worst]:.1%} of the radius",
        f"correct it, or free it (--refine {_refined(freed, wrong)})",
        case.named_cameras(cameras) if cameras else "",
        cameras=cameras,
        measures=_measures(name, before, after, sigma),
    )


def _told(name: str, before: FloatArray, after: FloatArray, sigma: FloatArray) -> str:
    if name == "f":
        share = after[0] / before[0] - 1
        return (
            f"{after[0]:,.5g} ± {sigma[0]:.1g} px, {abs(share):.1%} {'longer' if share > 0 else 'shorter'} "
            f"than the {before[0]:,.5g} px it is held at"
        )
    if name in _CENTRE:
        values = ", ".join(f"{a:.5g} ± {s:.1g}" for a, s in zip(after, sigma, strict=True))
        return f"({values}) px, and it is held at ({', '.join(f'{b:.5g}' for b in before)}) px"
    digits = ".4f" if name == "aspect" else ".3g"
    return f"{after[0]:{digits}} ± {sigma[0]:.1g}, and it is held at {before[0]:{digits}}"


def _measures(name: str, before: FloatArray, after: FloatArray, sigma: FloatArray) -> dict[str, float]:
    if name == "f":
        return {"focal_ratio": float(after[0] / before[0]), "focal_px": float(after[0])}
    if name in _CENTRE:
        axes = "xy" if len(before) == 2 else name[1]
        return {f"shift_{axis}_px": float(shift) for axis, shift in zip(axes, after - before, strict=True)}
    return {name: float(after[0]), "sigma": float(sigma[0])}


def _refined(freed: FreedIntrinsics, wrong: BoolArray) -> str:
    """Names of what is free and what is held at a wrong value; a distortion goes with f."""
    chosen: BoolArray = np.asarray(~freed.freed.problem.fixed_intrinsics[freed.rows].all(axis=0))
    chosen[freed.columns] = wrong.any(axis=0)
    if chosen[_K1]:
        chosen = np.zeros_like(chosen)
        chosen[[_F, _K1]] = True
    return ",".join(np.array(PERSPECTIVE)[chosen])
