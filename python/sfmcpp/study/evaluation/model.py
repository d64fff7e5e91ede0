"""Evaluation of a model against the truth, image by image and pair by pair."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry import agreeing_pairs, so3
from sfmcpp.map import Map
from sfmcpp.model import Problem, Trajectory
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.model.checks import require_not_negative, require_one_of
from sfmcpp.sensors.gps import between_origins
from sfmcpp.sources.io.files import is_folder
from sfmcpp.sources.io.trajectories import read_trajectory
from sfmcpp.study.evaluation.align import Alignment, AlignmentRule, fit_alignment
from sfmcpp.study.evaluation.associate import NEAREST_WITHIN_S
from sfmcpp.study.evaluation.image_poses import (
    ImagePoses,
    MatchedImages,
    Rows,
    images_of_model_path,
    is_problem_file,
    match_by_name,
    match_with_trajectory,
    read_image_poses,
)
from sfmcpp.study.evaluation.metrics import Statistics, auc, relative_pose_errors_deg

AUC_THRESHOLDS_DEG = (1.0, 3.0, 5.0, 10.0)
MODEL_ALIGNMENTS = ("all", "robust", "none")
# No model of the same photos has half of its images turned so far once it is aligned [deg].
_TURNED_DEG = 90.0
_ONE_ORIGIN = "the origin of the world is told by one of both alone: coordinates are compared as they are"

AnyPath = str | PathLike[str]


@dataclass(frozen=True, eq=False)
class ModelEvaluation:
    """A model measured against the truth; n of the truth's m images are in the model.

    Lengths are in the unit of the truth.

    Attributes
    ----------
    names : tuple of str
        The n images that are in both, as the truth names and orders them.
    estimate, truth : (n, 3, 4) float64
        Their poses ``[R | c]`` in the truth's world, the model's aligned.
    missing : tuple of str
        Images of the truth that the model does not have.
    unknown : tuple of str
        Images of the model that the truth does not have.
    matched_by : str
        What in their names told which image is which; see :class:`MatchedImages`.
    alignment : Alignment
        How the model was brought to the truth.
    aligned_by : (n,) bool
        Images that the alignment was fitted to.
    relative_errors_deg : (m (m − 1) / 2,) float64
        Error of the relative pose of every pair of the truth's images [deg], infinite where one is missing;
        see :func:`relative_pose_errors_deg`.
    note : str
        What limits the comparison; empty if nothing does.
    """

    names: tuple[str, ...]
    estimate: FloatArray
    truth: FloatArray
    missing: tuple[str, ...]
    unknown: tuple[str, ...]
    matched_by: str
    alignment: Alignment
    aligned_by: BoolArray
    relative_errors_deg: FloatArray
    note: str = ""

    @property
    def num_images(self) -> int:
        """How many images the truth has, m."""
        return len(self.names) + len(self.missing)

    @property
    def centre_errors(self) -> FloatArray:
        """(n,) distances of centres from the true ones, in the unit of the truth."""
        return np.asarray(np.linalg.norm(self.estimate[:, :, 3] - self.truth[:, :, 3], axis=1))

    @property
    def rotation_errors_deg(self) -> FloatArray:
        """(n,) angles between rotations and the true ones [deg]."""
        difference = np.swapaxes(self.truth[:, :, :3], 1, 2) @ self.estimate[:, :, :3]
        return np.asarray(np.rad2deg(so3.rotation_angle(difference)))

    @property
    def outliers(self) -> tuple[str, ...]:
        """Images that a robust alignment did not follow."""
        robust = self.alignment.rule.mode == "robust"
        left_out = zip(self.names, self.aligned_by, strict=True)
        return tuple(name for name, used in left_out if robust and not used)

    @property
    def warning(self) -> str:
        """Warning if the model and the truth do not seem to belong together; empty otherwise."""
        if self.alignment.warning or np.median(self.rotation_errors_deg) < _TURNED_DEG:
            return ""
        return (
            f"half of the images are turned by more than {_TURNED_DEG:.0f}°: are both of the same scene, in "
            "the same convention of axes, and are equal names of images the same images?"
        )

    def auc(self, threshold_deg: float) -> float:
        """Area, 0 to 1, under the recall curve of the relative poses up to an angle [deg]."""
        return auc(self.relative_errors_deg, threshold_deg)

    def to_dict(self) -> dict[str, Any]:
        """All that was measured, as plain values."""
        centres, rotations = self.centre_errors, self.rotation_errors_deg
        return {
            "images": {
                "truth": self.num_images,
                "registered": len(self.names),
                "missing": list(self.missing),
                "not_in_truth": list(self.unknown),
                "matched_by": self.matched_by,
            },
            "alignment": self._plain_alignment(),
            "centre_error": asdict(Statistics.of(centres)),
            "rotation_error_deg": asdict(Statistics.of(rotations)),
            "auc": {f"{threshold:g}": self.auc(threshold) for threshold in AUC_THRESHOLDS_DEG},
            "per_image": {
                name: {"centre_error": centre, "rotation_error_deg": rotation}
                for name, centre, rotation in zip(
                    self.names, centres.tolist(), rotations.tolist(), strict=True
                )
            },
            "note": self.note or None,
            "warning": self.warning or None,
        }

    def _plain_alignment(self) -> dict[str, Any]:
        """The unit of the truth need not be the metre."""
        plain = self.alignment.to_dict()
        plain["translation"] = plain.pop("translation_m")
        return {**plain, "outliers": list(self.outliers)}


@checked()
def evaluate_model(
    model: ImagePoses | Problem | Map | AnyPath,
    truth: ImagePoses | Problem | Map | Trajectory | AnyPath,
    *,
    align_to: str = "all",
    with_scale: bool = True,
    align_by: str = "positions",
    images: Sequence[str] | None = None,
    max_difference_s: float | None = None,
) -> ModelEvaluation:
    """Measure a model against the truth.

    Parameters
    ----------
    model : ImagePoses, Problem, Map or path-like
        What was reconstructed, its images named; a path as :func:`read_image_poses` reads it.
    truth : ImagePoses, Problem, Map, Trajectory or path-like
        True poses: of named images, matched by name; or a trajectory, matched as
        :func:`match_with_trajectory` does. A path is either.
    align_to : str
        ``"all"``: the similarity that brings all common centres nearest to the true ones. ``"robust"``: those
        that agree on one, more than half. ``"none"``: the model is in the truth's world, but for its origin
        where both tell theirs.
    with_scale : bool
        Whether the alignment changes the scale.
    align_by : str
        ``"positions"``, or ``"poses"``, which also holds for two images and on a straight line; see
        :func:`align`.
    images : sequence of str, optional
        With a trajectory: names of all images that could have been registered. Default: where `model` is a
        folder that ``sfmcpp reconstruct`` wrote, those of its report.
    max_difference_s : float, optional
        With a trajectory with times: how far in time the pose of an image may be [s]. Default: 0.01.

    Returns
    -------
    ModelEvaluation

    Raises
    ------
    InvalidArgument
        If an option breaks its rule, no image is in both, their poses do not determine the alignment, or,
        without one, the origin of one is geodetic and that of the other is not.
    DatasetError
        If a path cannot be read.
    """
    require_one_of("align_to", align_to, MODEL_ALIGNMENTS)
    limit_s = NEAREST_WITHIN_S if max_difference_s is None else max_difference_s
    require_not_negative("max_difference_s", limit_s)
    if images is None and isinstance(model, str | PathLike):
        images = images_of_model_path(Path(model))
    ours = read_image_poses(model) if isinstance(model, str | PathLike) else ImagePoses.of(model)
    true = read_truth(truth) if isinstance(truth, str | PathLike) else truth
    if max_difference_s is not None and not (isinstance(true, Trajectory) and true.stamped):
        raise InvalidArgument(f"max_difference_s = {max_difference_s}: the truth has no times")
    if isinstance(true, Trajectory):
        matched = match_with_trajectory(ours, true, images, limit_s)
    else:
        matched = match_by_name(ours, ImagePoses.of(true))
    return _measured(ours, matched, AlignmentRule(align_to), with_scale, align_by)


@checked()
def read_truth(path: AnyPath, format: str | None = None) -> ImagePoses | Trajectory:
    """Read true poses: named ones as :func:`read_image_poses`, else as :func:`read_trajectory`.

    Parameters
    ----------
    path : path-like
        A folder or problem file with named images, or a trajectory.
    format : str, optional
        Format of a trajectory, where its name and content do not tell.

    Returns
    -------
    ImagePoses or Trajectory

    Raises
    ------
    DatasetError
        If it cannot be read.
    """
    source = Path(path)
    if format is None and (is_folder(source) or is_problem_file(source)):
        return read_image_poses(source)
    return read_trajectory(source, format=format)


def _alignment(
    estimate: FloatArray, truth: FloatArray, rule: AlignmentRule, with_scale: bool, by: str
) -> Alignment:
    try:
        return fit_alignment(estimate, truth, rule, with_scale, by)
    except InvalidArgument as error:
        hint = "; poses hold on a line and of two images" if by == "positions" else ""
        reason = f"the {len(estimate)} images in both do not determine an alignment by {by}{hint}: {error}"
        raise InvalidArgument(reason) from error


def _measured(
    model: ImagePoses, matched: MatchedImages, rule: AlignmentRule, with_scale: bool, by: str
) -> ModelEvaluation:
    true, rows = matched.truth, matched.truth_rows
    estimate, truth = model.poses[matched.model_rows], true.poses[rows]
    used = np.ones(len(rows), dtype=np.bool_)
    if rule.mode == "robust":
        used = agreeing_pairs(estimate[:, :, 3], truth[:, :, 3], with_scale=with_scale)
    elif rule.mode == "none":
        used[:] = False
    alignment = _alignment(estimate[used], truth[used], rule, with_scale, by)
    notes = [matched.note]
    if rule.mode == "none" and model.origin is not None and true.origin is not None:
        alignment = replace(alignment, similarity=between_origins(model.origin, true.origin))
    elif rule.mode == "none" and (model.origin is not None or true.origin is not None):
        notes.append(_ONE_ORIGIN)
    aligned = alignment.similarity.apply_to_poses(estimate)
    placed = np.full((len(true), 3, 4), np.nan)
    placed[rows] = aligned
    return ModelEvaluation(
        tuple(true.names[row] for row in rows),
        aligned,
        truth,
        _names_without(true.names, rows),
        _names_without(model.names, matched.model_rows),
        matched.matched_by,
        alignment,
        used,
        relative_pose_errors_deg(placed, true.poses),
        "; ".join(note for note in notes if note),
    )


def _names_without(names: Sequence[str], rows: Rows) -> tuple[str, ...]:
    """Names of all rows but some, in their order."""
    return tuple(np.delete(np.array(names, dtype=object), rows).tolist())
