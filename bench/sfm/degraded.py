"""Reconstruct degraded copies of sets of photos, and compare each with the truth.

    python bench/sfm/degraded.py SET… [--out DIR] [--copies half,quarter,…] [--seed 0] [--threads 2]
                                 [--against DIR/degraded.json]

The photos alone are given, without EXIF. Where no true poses are known, those of the model of the photos as
they are, with K where there is one, are taken for them. A copy that was reconstructed in DIR is not
reconstructed again. Prints a table and writes it to DIR/degraded.md, and all figures, with the warnings, to
DIR/degraded.json; with --against, how many times as large the mean errors are as those of an earlier run.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from degraded_table import table_of_copies
from degrading import DEGRADATIONS, camera_turns, degrade
from image_sets import ImageSet, known_sets, set_of_folder
from measuring import figures
from running import run_side
from sfmcpp.errors import SfmcppError
from sfmcpp.study.evaluation import ImagePoses, evaluate_model, read_truth

# Where centres reach less than this part of their line beside it, rotations take part in the alignment.
STRAIGHT = 0.1


def main(arguments: Sequence[str] | None = None) -> None:
    """Make the copies, run each, print and write the table."""
    args = parse(arguments)
    rows: list[dict[str, Any]] = []
    for image_set in args.sets:
        truth = true_poses(image_set, args)
        for copy in args.copies:
            print(f"{image_set.name}: {copy} …", flush=True)
            rows += [row] if (row := measured(image_set, copy, truth, args)) else []
            publish(rows, args)
    print("\n" + (args.out / "degraded.md").read_text())


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    """The command line; `sets` becomes sets, `copies` a list, `against` rows by set and copy."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("sets", nargs="+", metavar="SET", help="name of a set of $SFMCPP_DATA, or a folder")
    parser.add_argument("--out", type=Path, default=Path("degraded"), help="folder of copies and models")
    parser.add_argument("--copies", default=",".join(DEGRADATIONS), help="which, separated by commas")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--against", type=Path, help="degraded.json of an earlier run")
    args = parser.parse_args(arguments)
    args.copies = [name.strip() for name in args.copies.split(",") if name.strip()]
    if unknown := set(args.copies) - set(DEGRADATIONS):
        parser.error(f"no copy {', '.join(sorted(unknown))}: must be of {', '.join(DEGRADATIONS)}")
    known = known_sets()
    args.sets = [known.get(text) or set_of_folder(Path(text), None, None) for text in args.sets]
    for image_set in args.sets:
        if not image_set.images.is_dir() or not image_set.names:
            parser.error(
                f"{image_set.name}: no photos in {image_set.images} (SFMCPP_DATA tells where sets are)"
            )
        if len({Path(name).stem for name in image_set.names}) < len(image_set.names):
            parser.error(f"{image_set.name}: photos are called the same, but for folders and suffixes")
    before = json.loads(args.against.read_text())["rows"] if args.against else []
    args.against = {(row["set"], row["copy"]): row for row in before}
    return args


def true_poses(image_set: ImageSet, args: argparse.Namespace) -> ImagePoses:
    """Those that are known, or else those of the model of the photos themselves."""
    if image_set.truth is not None:
        truth = read_truth(image_set.truth)
        if isinstance(truth, ImagePoses):
            return truth
        if len(truth) == len(image_set.names):
            return ImagePoses(tuple(image_set.names), truth.poses)
    print(f"{image_set.name}: the photos themselves …", flush=True)
    folder = args.out / image_set.name / "itself"
    reconstructed(image_set, folder, args.threads)
    return ImagePoses.of(read_truth(folder / "model"))


def reconstructed(image_set: ImageSet, folder: Path, threads: int) -> dict[str, Any]:
    """What the run of a set says, from `folder` if it has been run there."""
    done = folder / "run.json"
    return json.loads(done.read_text()) if done.exists() else run_side("sfmcpp", image_set, folder, threads)


def measured(
    image_set: ImageSet, copy: str, truth: ImagePoses, args: argparse.Namespace
) -> dict[str, Any] | None:
    """One row: the copy of a set, reconstructed; None if the set has no such copy."""
    folder = args.out / image_set.name / f"{copy}-{args.seed}"
    photos = [image_set.images / name for name in image_set.names]
    rolls = degrade(photos, copy, folder / "photos", seed=args.seed, matrix=image_set.camera())
    if not rolls:
        return None
    of_copy = ImageSet(copy, folder / "photos")
    row = figures(of_copy, folder, reconstructed(of_copy, folder, args.threads))
    row |= {"set": image_set.name, "copy": copy, "seed": args.seed}
    if not row["registered"]:
        return row
    try:
        true, by = turned_truth(truth, rolls), "poses" if is_straight(truth) else "positions"
        errors = evaluate_model(folder / "model", true, align_by=by).to_dict()
    except SfmcppError as error:
        return {**row, "truth_error": str(error)}
    return {**row, "truth": errors, "extent": extent(truth)}


def turned_truth(truth: ImagePoses, rolls: dict[str, float]) -> ImagePoses:
    """True poses of the cameras that would take the copies, which are turned, of the same images."""
    by_stem = {Path(name).stem: row for row, name in enumerate(truth.names)}
    names = [name for name in rolls if Path(name).stem in by_stem]
    poses = truth.poses[[by_stem[Path(name).stem] for name in names]].copy()
    poses[:, :, :3] = poses[:, :, :3] @ camera_turns([rolls[name] for name in names])
    return ImagePoses(tuple(names), poses)


def is_straight(truth: ImagePoses) -> bool:
    """Whether the true centres are so near to a line that they hardly tell the rotation about it."""
    centres = truth.poses[:, :, 3]
    reach = np.linalg.svd(centres - centres.mean(axis=0), compute_uv=False)
    return bool(reach[1] < STRAIGHT * reach[0])


def extent(truth: ImagePoses) -> float:
    """Twice the largest distance of a true centre from the mean of all."""
    centres = truth.poses[:, :, 3]
    return 2 * float(np.linalg.norm(centres - centres.mean(axis=0), axis=1).max())


def publish(rows: list[dict[str, Any]], args: argparse.Namespace) -> None:
    """Write the table and the figures so far."""
    (args.out / "degraded.md").write_text(table_of_copies(rows, args.against) + "\n")
    (args.out / "degraded.json").write_text(json.dumps({"seed": args.seed, "rows": rows}, indent=1))


if __name__ == "__main__":
    main()
