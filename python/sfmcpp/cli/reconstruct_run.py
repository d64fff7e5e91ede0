"""From photos or tracks to a folder of results, ended in order by Ctrl-C."""

from __future__ import annotations

import webbrowser
from pathlib import Path
from typing import Any

from sfmcpp import sfm
from sfmcpp.cli.display import shown_stages
from sfmcpp.cli.exit_codes import ExitCode, say, tell, tell_error
from sfmcpp.cli.running import ctrl_c_noted, made, require_folder
from sfmcpp.study import SfmReport
from sfmcpp.study.pages.sfm_page import VIEW
from sfmcpp.study.sfm_files import PAGE

# What an interrupted run has done, for `--resume`; in the folder of the results.
CACHE = "cache"


def run_reconstruction(
    source: Path, folder: Path, options: dict[str, Any], *, view: bool = False, quiet: bool = False
) -> ExitCode:
    """Reconstruct, write, print.

    Raises
    ------
    DatasetError
        If the input cannot be read, or the folder cannot be written.
    InvalidArgument
        If an option asks for what there is not.
    """
    require_folder(folder)
    room: Any = sfm
    with made(folder):
        with shown_stages(quiet=quiet) as show, ctrl_c_noted() as asked_to_stop:

            def progress(stage: str, done: int, total: int) -> bool:
                show(stage, done, total)
                return asked_to_stop()

            run = room.reconstruct(source, cache=folder / CACHE, progress=progress, **options)
        code = _finish(SfmReport(run), source, folder, quiet)
    if view and run.model is not None and not run.interrupted:
        _open(folder / VIEW, quiet)
    return code


def _finish(report: SfmReport, source: Path, folder: Path, quiet: bool) -> ExitCode:
    run = report.run
    written = report.write(folder)
    if run.model is None:
        if run.interrupted:
            tell(
                f"interrupted before there was a model: --resume goes on, {folder / PAGE} tells how far it came"
            )
            return ExitCode.INTERRUPTED
        return tell_error(f"{source}: {report.verdict()}; {folder / PAGE} tells more")
    if not quiet:
        say(report.table(written))
    if run.interrupted:
        images = f"{run.num_registered:,} of {len(run.images):,} images"
        tell(f"interrupted with {images} in the model: it is in {folder}, --resume goes on")
        return ExitCode.INTERRUPTED
    if report.is_partial and not quiet:
        tell(f"warning: partial model: {report.verdict()}")
    return ExitCode.DONE


def _open(page: Path, quiet: bool) -> None:
    opened = webbrowser.open(page.resolve().as_uri())
    if not opened and not quiet:
        tell(f"no browser could be opened: the model is shown by {page}")
