"""`sfmcpp evaluate`: a trajectory or a model against the truth, as a table, a report and a picture."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sfmcpp.cli.choices import Quiet, choice_option
from sfmcpp.cli.console import ExitCode, print_result, with_exit_code
from sfmcpp.cli.flags import flag_of, options_of, with_flags
from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.sources.io.files import is_folder, is_present, is_regular_file

if TYPE_CHECKING:
    from sfmcpp.cli.targets import Targets
    from sfmcpp.study.evaluation import Evaluation, ModelEvaluation


# Those of the readers, named here so that --help imports none of them.
FORMATS = ("tum", "kitti", "euroc", "mat")
Source = Annotated[
    Path,
    typer.Argument(
        metavar="MODEL|TRAJECTORY",
        help="A COLMAP model, the output of reconstruct, a problem with named images; or a trajectory.",
    ),
]
Truth = Annotated[
    Path,
    typer.Option(
        "--truth",
        metavar="PATH",
        help="True trajectory; for a model also a model in any format with names of images, "
        "transforms.json among them, or a folder of Strecha's IMAGE.camera files.",
    ),
]
Align = Annotated[
    str,
    typer.Option(
        metavar="all|none|first:N|robust",
        help="Poses used for alignment. first:0.1: the first tenth of a trajectory, rounded up; robust: of a "
        "model alone, the images that agree.",
    ),
]
# Options of trajectories that mean nothing for images, with their defaults.
_OF_TRAJECTORIES = {"match": "nearest", "delta": 1.0, "delta_unit": "frames", "all_pairs": False}
_SHOWN = 8
_COLUMNS = ("mean", "median", "max", "rmse")


def _format(what: str) -> Any:
    return choice_option(FORMATS, f"Format of {what}", "; default: by its name")


@with_exit_code
def evaluate(
    source: Source,
    truth: Truth,
    align: Align = "all",
    scale: Annotated[bool, typer.Option("--scale/--no-scale", help="Align with or without scale.")] = True,
    align_by: Annotated[
        str,
        choice_option(("positions", "poses"), "What to align; poses also work on straight roads"),
    ] = "positions",
    match: Annotated[
        str,
        choice_option(("nearest", "interpolate"), "How true poses are matched to estimated ones"),
    ] = "nearest",
    max_difference_s: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS",
            help="Largest time difference of matched poses, where the truth has times; at least 0. Default: "
            "0.01, or 0.5 with interpolate.",
        ),
    ] = None,
    delta: Annotated[
        float, typer.Option(metavar="N", help="Interval of relative errors, positive; of frames whole.")
    ] = 1.0,
    delta_unit: Annotated[str, choice_option(("frames", "m"), "Unit of --delta")] = "frames",
    all_pairs: Annotated[bool, typer.Option("--all-pairs", help="Relative errors from every pose.")] = False,
    format: Annotated[str | None, _format("the trajectory")] = None,
    truth_format: Annotated[str | None, _format("the truth")] = None,
    report: Annotated[Path | None, typer.Option(metavar="FILE", help="Write a report as JSON.")] = None,
    plot: Annotated[Path | None, typer.Option(metavar="FILE", help="Plot both: png, svg, pdf.")] = None,
    quiet: Quiet = False,
) -> ExitCode:
    """Evaluate a model or a trajectory against ground truth.

    Trajectory: mean 3-D error, scale, absolute and relative pose errors. Model, per image: errors of
    centres and rotations, AUC of relative poses, missing images.
    """
    from sfmcpp.cli.targets import Targets

    options = {
        "align_to": align,
        "with_scale": scale,
        "align_by": align_by,
        "match": match,
        "max_difference_s": max_difference_s,
        "delta": delta,
        "delta_unit": delta_unit,
        "all_pairs": all_pairs,
    }
    targets = Targets(None, report, plot)
    found: Evaluation | ModelEvaluation
    if format is None and _names_images(source):
        found = _evaluated_model(source, truth, truth_format, options, targets)
        rows = _model_rows(source, truth, found, targets)
    else:
        found = _evaluated_trajectory((source, format), (truth, truth_format), options, targets)
        rows = _trajectory_rows(source, truth, found, targets)
    _write(source, truth, found, targets)
    if not quiet:
        print_result("\n".join(f"{name:<16}{value}" if name else value for name, value in rows))
    return ExitCode.DONE


def _evaluated_trajectory(
    ours: tuple[Path, str | None], true: tuple[Path, str | None], options: dict[str, Any], targets: Targets
) -> Evaluation:
    """Read both, a file and its format each, and compare them; all that can be checked is checked before."""
    from sfmcpp.sources.io.trajectories import read_trajectory
    from sfmcpp.study import evaluation

    evaluation.AlignmentRule.parse(options["align_to"])
    _require_trajectories(ours[0], *true)
    targets.check(ours[0], true[0])
    read = [read_trajectory(path, format=name) for path, name in (ours, true)]
    try:
        return evaluation.evaluate(*read, **options)
    except InvalidArgument as error:
        told = with_flags(str(error), options_of(evaluate) - {"truth"})  # whose file is named
        raise DatasetError(ours[0], f"compared with {true[0]}: {told}") from error


def _require_trajectories(ours: Path, true: Path, true_format: str | None) -> None:
    if is_present(ours) and true_format is None and _names_images(true):
        raise DatasetError(
            ours,
            f"is taken for a trajectory, but the truth {true} for a model: only a model (a COLMAP folder, a "
            "problem with named images) can be matched with that",
        )


def _write(ours: Path, true: Path, found: Evaluation | ModelEvaluation, targets: Targets) -> None:
    if targets.report is not None:
        from sfmcpp.study.report_files import write_report

        content = {"input": {"path": str(ours), "truth": str(true)}, **found.to_dict()}
        write_report(content, targets.report)
    if targets.picture is not None:
        from sfmcpp.study.evaluation import Evaluation
        from sfmcpp.study.plotting import save_figure
        from sfmcpp.study.plotting.evaluations import plot_evaluation, plot_model_evaluation

        figure = plot_evaluation(found) if isinstance(found, Evaluation) else plot_model_evaluation(found)
        save_figure(figure, targets.picture)


def _trajectory_rows(
    trajectory: Path, truth: Path, found: Evaluation, targets: Targets
) -> Iterator[tuple[str, str]]:
    """Names and values; lines of the tables of errors have no name."""
    content, alignment = found.to_dict(), found.alignment
    scaled = f", scale {alignment.similarity.scale:.6g}" if alignment.with_scale else ""
    yield "trajectory", str(trajectory)
    yield "truth", f"{truth}, {found.truth.length_m:.2f} m long"
    yield "matched", f"{len(found.estimate)} poses"
    yield "aligned to", f"{alignment.rule}: {alignment.count} {alignment.by}{scaled}"
    yield "mean 3-D error", f"{found.mean_3d_error_m:.6g} m"
    yield "scale ratio", _scale_text(found)
    over = f"RPE over {found.rpe_delta[0]:g} {found.rpe_delta[1]}"
    for title, errors in (("APE", content["ape"]), (over, content["rpe"])):
        yield from (("", line) for line in ("", *_error_table(title, errors)))
    yield from (("warning", text) for text in (found.warning, alignment.warning) if text)
    yield from (("written", str(path)) for path in targets)


def _scale_text(evaluation: Evaluation) -> str:
    ratio = evaluation.scale_ratio
    if ratio is None:
        return "undefined: the ground truth does not move"
    return f"mean {ratio.mean:.6g}, median {ratio.median:.6g}, std {ratio.std:.6g}, max {ratio.max:.6g}"


def _error_table(title: str, content: dict[str, Any]) -> list[str]:
    tables = {relation: values for relation, values in content.items() if isinstance(values, dict)}
    names = list(next(iter(tables.values())))
    header = "".join(f"{name:>12}" for name in names)
    rows = [
        f"  {relation:<20}" + "".join(f"{values[name]:>12.5g}" for name in names)
        for relation, values in tables.items()
    ]
    return [f"{title:<22}{header}", *rows]


def _names_images(path: Path) -> bool:
    """Whether `path` is a model or a truth with named images, by its name and kind."""
    from sfmcpp.study.evaluation.image_poses import is_problem_file

    return is_folder(path) or (is_present(path) and is_problem_file(path))


def _evaluated_model(
    model: Path, truth: Path, truth_format: str | None, options: dict[str, Any], targets: Targets
) -> ModelEvaluation:
    from sfmcpp.study.evaluation import evaluate_model, read_image_poses, read_truth
    from sfmcpp.study.evaluation.image_poses import images_of_model_path
    from sfmcpp.study.evaluation.model import MODEL_ALIGNMENTS

    for name, default in _OF_TRAJECTORIES.items():
        if options[name] != default:
            raise DatasetError(
                model, f"is a model: {flag_of(name)} is for trajectories, models have no order in time"
            )
    if options["align_to"] not in MODEL_ALIGNMENTS:
        known = ", ".join(MODEL_ALIGNMENTS)
        raise InvalidArgument(f"align = {options['align_to']!r}: must be one of {known} for a model")
    targets.check(model, truth, model / "report.json")
    ours, true = read_image_poses(model), read_truth(truth, truth_format)
    wanted = {name: options[name] for name in ("align_to", "with_scale", "align_by")}
    if options["max_difference_s"] is not None:
        wanted["max_difference_s"] = options["max_difference_s"]
    try:
        return evaluate_model(ours, true, images=images_of_model_path(model), **wanted)
    except InvalidArgument as error:
        path = model / "trajectory.txt"
        hint = f"; did you mean {path}?" if is_regular_file(path) else ""
        raise DatasetError(model, f"compared with {truth}: {error}{hint}") from error


def _model_rows(
    model: Path, truth: Path, found: ModelEvaluation, targets: Targets
) -> Iterator[tuple[str, str]]:
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
            yield name, _first_names(images)
    yield "aligned to", f"{alignment.rule}: {alignment.count} {alignment.by}{scaled}"
    areas = (f"{100 * area:.2f} % at {threshold}°" for threshold, area in content["auc"].items())
    yield "AUC", ", ".join(areas)
    yield "", ""
    yield "", f"{'errors':<22}" + "".join(f"{name:>12}" for name in _COLUMNS)
    for what, key in (("centre", "centre_error"), ("rotation [deg]", "rotation_error_deg")):
        yield "", f"  {what:<20}" + "".join(f"{content[key][name]:>12.5g}" for name in _COLUMNS)
    yield from (("warning", text) for text in (alignment.warning, found.warning, found.note) if text)
    yield from (("written", str(path)) for path in targets)


def _first_names(names: Sequence[str]) -> str:
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return f"{len(names)}: " + ", ".join(names[:_SHOWN]) + more
