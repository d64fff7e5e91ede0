"""`sfmcpp undistort`: photos of a model without distortion, and the model of these."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sfmcpp.cli.choices import OutputFolder, Quiet
from sfmcpp.cli.console import ExitCode, print_result, with_exit_code

Model = Annotated[
    Path,
    typer.Argument(metavar="MODEL", help="A model with names of photos: a COLMAP folder, sfm_data.json, …"),
]
Photos = Annotated[Path, typer.Argument(metavar="PHOTOS", help="Folder of its photos.")]


@with_exit_code
def undistort(model: Model, photos: Photos, output: OutputFolder, quiet: Quiet = False) -> ExitCode:
    """Write the photos of a model without distortion, and their model.

    DIR gets images/ and sparse/0 (COLMAP, PINHOLE cameras), as Gaussian splatting and dense reconstruction
    read them.
    """
    from sfmcpp.cli.display import shown_stages
    from sfmcpp.cli.reading import read_with_notes
    from sfmcpp.cli.targets import writable_folder
    from sfmcpp.sources.vision.undistortion import IMAGES, MODEL, undistort_photos

    problem = read_with_notes(model)
    with writable_folder(output), shown_stages(quiet=quiet) as show:
        made = undistort_photos(problem, photos, output, progress=show)
    if not quiet:
        widths, heights = made.metadata.image_sizes.T if made.metadata.image_sizes is not None else ([], [])
        sizes = sorted({f"{w}×{h}" for w, h in zip(widths, heights, strict=True)})
        of_size = f" of {sizes[0]} px" if len(sizes) == 1 else ""
        print_result(f"{output / IMAGES}: {made.num_cameras} images{of_size} without distortion")
        print_result(f"{output / MODEL}: their model, PINHOLE cameras with the principal point at the centre")
    return ExitCode.DONE
