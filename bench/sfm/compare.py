"""Reconstruct sets of photos with COLMAP and with sfmcpp, side by side; see README.md beside this file."""

from __future__ import annotations

import argparse
import json
import os
import platform
from collections.abc import Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from image_sets import ImageSet, known_sets, set_of_folder
from measuring import figures
from running import SIDES, run_side
from table import markdown_table, notes


def main(arguments: Sequence[str] | None = None) -> None:
    """Run both sides on every set; print the table, write it and all figures."""
    args = parse(arguments)
    args.out.mkdir(parents=True, exist_ok=True)
    limit_processors(args.threads)
    rows: list[dict[str, Any]] = []
    for image_set in args.sets:
        for side in args.only:
            print(f"{image_set.name}: {side} …", flush=True)
            rows.append(measured(side, image_set, args))
            publish(rows, args)
    print("\n" + (args.out / "table.md").read_text())


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    """The command line; `sets` becomes sets, `only` a list of sides."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "sets",
        nargs="*",
        metavar="SET",
        help="name of a set of $SFMCPP_DATA, or a folder; default: all",
    )
    parser.add_argument("--out", type=Path, default=Path("sfm-results"), help="folder of tables and models")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--only", default=",".join(SIDES), help="sides, separated by commas")
    parser.add_argument("--reuse", default="", help="sides whose figures in --out are taken, not run again")
    parser.add_argument("--camera", metavar="K.txt|auto", help="of folders: K, or nothing given")
    parser.add_argument("--truth", type=Path, help="of folders: true poses, as sfmcpp evaluate reads them")
    args = parser.parse_args(arguments)
    args.only, args.reuse = (split(text) for text in (args.only, args.reuse))
    if unknown := set(args.only + args.reuse) - set(SIDES):
        parser.error(f"no side {', '.join(sorted(unknown))}: must be of {', '.join(SIDES)}")
    known = known_sets()
    args.sets = [known.get(text) or folder_set(text, args, parser) for text in args.sets or known]
    for image_set in args.sets:
        if not image_set.images.is_dir() or not image_set.names:
            parser.error(
                f"{image_set.name}: no photos in {image_set.images} (SFMCPP_DATA tells where sets are)"
            )
    return args


def folder_set(text: str, args: argparse.Namespace, parser: argparse.ArgumentParser) -> ImageSet:
    """The set of a folder given on the command line."""
    if not Path(text).is_dir():
        parser.error(f"{text!r} is no folder and no name of a set: {', '.join(known_sets())}")
    return set_of_folder(Path(text), args.camera, args.truth)


def split(text: str) -> list[str]:
    """The names in a list separated by commas."""
    return [name.strip() for name in text.split(",") if name.strip()]


def limit_processors(threads: int) -> None:
    """Give this process and its children no more processors than threads, where the system can."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:threads])


def measured(side: str, image_set: ImageSet, args: argparse.Namespace) -> dict[str, Any]:
    """Run one side on one set, or take what an earlier run found; ``OUT/SIDE/SET.json`` has it."""
    file = args.out / side / f"{image_set.name}.json"
    if side in args.reuse and file.exists():
        return {**json.loads(file.read_text()), "reused": True}
    folder = args.out / side / image_set.name
    row = {"side": side, **figures(image_set, folder, run_side(side, image_set, folder, args.threads))}
    file.write_text(json.dumps(row, indent=1))
    return row


def publish(rows: list[dict[str, Any]], args: argparse.Namespace) -> None:
    """Write the table and the figures so far."""
    heading = f"{args.threads} threads, {platform.platform()}, {os.cpu_count()} processors"
    text = [heading, "", markdown_table(rows), "", *(f"- {line}" for line in notes(rows))]
    (args.out / "table.md").write_text("\n".join(text) + "\n")
    document = {
        "date": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "machine": platform.platform(),
        "processors": os.cpu_count(),
        "threads": args.threads,
        "rows": rows,
    }
    (args.out / "results.json").write_text(json.dumps(document, indent=1))


if __name__ == "__main__":
    main()
