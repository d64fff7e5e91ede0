"""The options that save checkpoints and resume an earlier run."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from sfmcpp.cli.console import print_note
from sfmcpp.errors import DatasetError
from sfmcpp.sources.io.checkpoints import CheckpointFolder
from sfmcpp.sources.io.files import is_present


@dataclass(frozen=True)
class Checkpoints:
    """The options `--checkpoint`, `--checkpoint-every` and `--resume`."""

    folder: Path | None = None
    every_s: float = 60.0
    resumed: Path | None = None

    @cached_property
    def begins_anew(self) -> bool:
        """Whether a run that shall go on in a folder of its own checkpoints has none there yet.

        So one command serves a job that is started again after it was stopped, however early.
        """
        if self.folder is None or self.folder != self.resumed:
            return False
        return CheckpointFolder(self.folder).is_empty()

    @cached_property
    def save(self) -> CheckpointFolder | None:
        """Folder to save in."""
        return None if self.folder is None else CheckpointFolder(self.folder, self.every_s)

    @cached_property
    def resume(self) -> CheckpointFolder | None:
        """Folder to resume from."""
        return None if self.resumed is None or self.begins_anew else CheckpointFolder(self.resumed)

    def check(self, *, quiet: bool) -> None:
        """Raise a DatasetError for what cannot be saved or taken up, before any work is done."""
        if self.begins_anew and not quiet:
            print_note(f"note: {self.folder}: holds no checkpoint yet, the run begins at its start")
        if self.resume is not None:
            self.resume.load()
        if self.save is not None:
            self.save.begin(self.resume)

    def check_input_stays(self, source: Path, output: Path | None) -> None:
        """Raise a DatasetError if the result would replace the input, which a resumed run reads again."""
        if self.save is not None and output is not None and is_present(output) and output.samefile(source):
            raise DatasetError(output, "would replace the input, which a run that goes on needs")

    @property
    def failures(self) -> list[DatasetError]:
        """Errors of checkpoints that could not be saved."""
        return [self.save.failure] if self.save is not None and self.save.failure is not None else []

    @property
    def in_words(self) -> tuple[str, ...]:
        """Hint how to resume a run that was stopped, if it can be."""
        return () if self.folder is None else (f"continue with --resume {self.folder}",)
