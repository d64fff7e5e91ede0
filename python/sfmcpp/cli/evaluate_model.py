"""A model against the truth on the command line: what `sfmcpp evaluate` does for named images."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sfmcpp.cli.exit_codes import ExitCode, say
from sfmcpp.errors import DatasetError, InvalidArgument

if TYPE_CHECKING:
    from sfmcpp.cli.targets import Targets
    from sfmcpp.study.evaluation import ModelEvaluation

# Options of trajectories that mean nothing for images, with their defaults.
_OF_TRAJECTORIES = {"match": "nearest", "delta": 1.0, "delta_unit": "frames", "all_pairs": False}
_SHOWN = 8
_COLUMNS = ("mean", "median", "max", "rmse")


def names_images(path: Path) -> bool:
    """Whether `path` is a model or a truth with named images, as far as its name and kind tell."""
    from sfmcpp.study.evaluation.image_poses import is_problem_file

    return path.is_dir() or (path.exists() and is_problem_file(path))


def evaluate_model_files(
    model: Path, truth: Path, truth_format: str | None, options: dict[str, Any], targets: Targets, quiet: bool
) -> ExitCode:
    """Measure the model, write what is wanted, and print a table."""
    found = _evaluated(model, truth, truth_format, options, targets)
    if targets.report is not None:
        from sfmcpp.study.report_files import write_report

        content = {"input": {"path": str(model), "truth": str(truth)}, **found.to_dict()}
        write_report(content, targets.report)
    if targets.picture is not None:
        from sfmcpp.study.plotting import save_figure
        from sfmcpp.study.plotting.evaluations import plot_model_evaluation

        save_figure(plot_model_evaluation(found), targets.picture)
    if not quiet:
        rows = _rows(model, truth, found, targets)
        say("\n".join(f"{name:<16}{value}" if name else value for name, value in rows))
    return ExitCode.DONE


def _evaluated(
    model: Path, truth: Path, truth_format: str | None, options: dict[str, Any], targets: Targets
) -> ModelEvaluation:
    from sfmcpp.study.evaluation import evaluate_model, read_image_poses, read_truth
    from sfmcpp.study.evaluation.image_poses import images_asked_for
    from sfmcpp.study.evaluation.model import MODEL_ALIGNMENTS

    for name, default in _OF_TRAJECTORIES.items():
        if options[name] != default:
            flag = "--" + name.replace("_", "-")
            raise DatasetError(model, f"is a model: {flag} is for trajectories, models have no order in time")
    if options["align_to"] not in MODEL_ALIGNMENTS:
        known = ", ".join(MODEL_ALIGNMENTS)
        raise InvalidArgument(f"align = {options['align_to']!r}: must be one of {known} for a model")
    for source in (model, truth, model / "report.json"):
        targets.check(source)
    ours, true = read_image_poses(model), read_truth(truth, truth_format)
    wanted = {name: options[name] for name in ("align_to", "with_scale", "align_by")}
    if options["max_difference_s"] is not None:
        wanted["max_difference_s"] = options["max_difference_s"]
    try:
        return evaluate_model(ours, true, images=images_asked_for(model), **wanted)
    except InvalidArgument as error:
        raise DatasetError(model, f"compared with {truth}: {error}") from error


def _rows(model: Path, truth: Path, found: ModelEvaluation, targets: Targets) -> Iterator[tuple[str, str]]:
    """Names and values; lines of the table of errors have no name."""
    content, alignment = found.to_dict(), found.alignment
    scaled = f", scale {alignment.similarity.scale:.6g}" if alignment.with_scale else ""
    yield "model", str(model)
    yield "truth", f"{truth}, {found.num_images} images"
    yield "registered", f"{len(found.names)} of {found.num_images}, matched by {found.matched_by}"
    for name, images in (
        ("missing", found.missing),
        ("not in truth", found.unknown),
        ("outliers", found.outliers),
    ):
        if images:
            yield name, _some(images)
    yield "aligned to", f"{alignment.rule}: {alignment.count} {alignment.by}{scaled}"
    areas = (f"{100 * area:.2f} % at {threshold}°" for threshold, area in content["auc"].items())
    yield "AUC", ", ".join(areas)
    yield "", ""
    yield "", f"{'errors':<22}" + "".join(f"{name:>12}" for name in _COLUMNS)
    for what, key in (("centre", "centre_error"), ("rotation [deg]", "rotation_error_deg")):
        yield "", f"  {what:<20}" + "".join(f"{content[key][name]:>12.5g}" for name in _COLUMNS)
    yield from (("warning", text) for text in (alignment.warning, found.note) if text)
    yield from (("written", str(path)) for path in targets)


def _some(names: Sequence[str]) -> str:
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return f"{len(names)}: " + ", ".join(names[:_SHOWN]) + more
