"""A reconstruction written to a results folder; Ctrl-C keeps what there is."""

from __future__ import annotations

import re
import webbrowser
from pathlib import Path
from typing import Any

from sfmcpp.cli.console import ExitCode, print_error, print_no_result, print_note, print_result
from sfmcpp.cli.display import shown_stages
from sfmcpp.cli.flags import with_flags
from sfmcpp.cli.georeferencing import Gps, write_camera_positions
from sfmcpp.cli.interrupts import noted_interrupt
from sfmcpp.cli.targets import Targets, require_results_folder, writable_folder
from sfmcpp.errors import InvalidArgument
from sfmcpp.sfm import reconstruct
from sfmcpp.sfm.outcome import NO_MODEL
from sfmcpp.sources.io.files import failures_named, require_present
from sfmcpp.study import SfmReport
from sfmcpp.study.report_files import VIEW
from sfmcpp.study.sfm_files import FILES, PAGE

# What an interrupted run has done, for `--resume`; in the folder of the results.
CACHE = "cache"
_ENTRY = re.compile(r"[0-9a-f]{40}")


def run_reconstruction(
    source: Path,
    folder: Path,
    options: dict[str, Any],
    targets: Targets,
    *,
    resume: bool,
    view: bool,
    quiet: bool,
) -> ExitCode:
    """Reconstruct, write, print; of the targets, those beside the folder.

    Raises
    ------
    DatasetError
        If the input cannot be read, or the folder cannot be written.
    InvalidArgument
        If an option asks for what there is not.
    """
    require_results_folder(folder, FILES)
    require_present(source)
    positions = options["gps"] if isinstance(options["gps"], Path) else None
    with writable_folder(folder):  # which may hold the targets, too
        targets.check(source, *([] if positions is None else [positions]))
        Gps(positions).check(targets.positions)
        if not resume:
            _clear_cache(folder / CACHE)
        with shown_stages(quiet=quiet) as show, noted_interrupt() as asked_to_stop:

            def progress(stage: str, done: int, total: int) -> bool:
                show(stage, done, total)
                return asked_to_stop()

            try:
                run = reconstruct(source, cache=folder / CACHE, progress=progress, **options)
            except ModuleNotFoundError as error:  # it says how to install what is missing
                raise InvalidArgument(str(error)) from None
            except KeyboardInterrupt:
                print_note(f"{folder} keeps what was computed: continue with --resume")
                raise
        code = _finish(SfmReport(run), source, folder, targets, quiet)
    if view and run.model is not None and not run.interrupted:
        _open_page(folder / VIEW, quiet)
    return code


def _clear_cache(cache: Path) -> None:
    """Remove what earlier runs have kept, and nothing else that may be there."""
    for entry in cache.glob("*/*"):
        if _ENTRY.fullmatch(entry.name):
            with failures_named(entry):
                entry.unlink()


def _finish(report: SfmReport, source: Path, folder: Path, targets: Targets, quiet: bool) -> ExitCode:
    run = report.run
    with noted_interrupt():
        written = report.write(folder)
    if run.model is None:
        more = f"see {folder / PAGE}" if written else f"{folder} keeps the model of an earlier run"
        if run.interrupted:
            print_note(f"interrupted before a model was found: {more}; continue with --resume")
            return ExitCode.INTERRUPTED
        for warning in run.warnings:
            if not (quiet or warning.startswith(NO_MODEL)):  # that is in the verdict
                print_note(f"warning: {warning}")
        return print_no_result(f"{source}: {report.verdict()}; {more}")
    if targets.positions is not None and not run.gps_failure:
        write_camera_positions(targets.positions, run.problem(), run.gps)
        written.append(targets.positions)
    if not quiet:
        print_result(report.table(written))
    if run.interrupted:
        images = f"{run.num_registered:,} of {len(run.images):,} images"
        print_note(f"interrupted with {images} in the model, written to {folder}; continue with --resume")
        return ExitCode.INTERRUPTED
    if run.gps_failure:
        why = with_flags(run.gps_failure, {"gps"})
        return print_error(f"{why}; {folder} has the model, without positions")
    if report.is_partial and not quiet:
        print_note(f"warning: partial model: {report.verdict()}")
    return ExitCode.DONE


def _open_page(page: Path, quiet: bool) -> None:
    opened = webbrowser.open(page.resolve().as_uri())
    if not opened and not quiet:
        print_note(f"no browser could be opened; open {page} to see the model")
