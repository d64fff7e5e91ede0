"""Rendered photos and what the command line makes of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from cli_helpers import strict_json
from sfmcpp.cli.main import main
from sfmcpp.model import Problem
from sfmcpp.sources.synthetic.photos import render_photos

SMALL = (320, 240)


def photos_of(name: str, folder: Path, num_images: int, **options: Any) -> Problem:
    """Small photos of a place, and the truth."""
    return render_photos(name, folder, num_images=num_images, **{"image_size": SMALL, **options})


def reconstructed(folder: Path, out: Path, *options: str) -> tuple[int, dict[str, Any]]:
    """Exit code and report of ``sfmcpp reconstruct``."""
    code = main(["reconstruct", str(folder), "-o", str(out), "--quiet", *options])
    return code, strict_json(out / "report.json") if (out / "report.json").exists() else {}


def results(out: Path) -> dict[str, bytes]:
    """All files of a result but its cache and what time it took."""
    return {
        path.relative_to(out).as_posix(): path.read_bytes()
        for path in sorted(out.rglob("*"))
        if path.is_file() and path.name != "timings.json" and "cache" not in path.parts
    }


def registered(report: dict[str, Any]) -> list[str]:
    """Names of the images with a pose."""
    return [name for name, outcome in report["images"].items() if outcome["registered"]]
