"""Tables and pictures of docs/benchmarks.md, from the results in bench/results.

    python bench/tables.py [--results DIR] [--page FILE]

Between ``<!-- NAME -->`` and ``<!-- end -->`` the page gets NAME.md of the results (scale, set, stored-w,
versions), which the benchmarks write. Beside it the performance profile of the set and the roofline of the
kernels are drawn, if their results are there (set.json; machine.json and kernels.json).
"""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

BENCH = Path(__file__).resolve().parent
PAGE = BENCH.parent / "docs" / "benchmarks.md"
_SECTION = re.compile(r"(<!-- ([a-z-]+) -->\n).*?(<!-- end -->)", re.DOTALL)
_LINES = ("-", "--", ":", "-.")


def main(arguments: Sequence[str] | None = None) -> None:
    """Fill in the page and draw."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--results", type=Path, default=BENCH / "results")
    parser.add_argument("--page", type=Path, default=PAGE)
    args = parser.parse_args(arguments)
    args.page.write_text(filled(args.page.read_text(), args.results))
    found = {path.stem: json.loads(path.read_text()) for path in args.results.glob("*.json")}
    if "set" in found:
        draw_profile(found["set"], args.page.with_name("performance-profile.svg"))
    if "machine" in found and "kernels" in found:
        draw_roofline(found["machine"], found["kernels"], args.page.with_name("roofline.svg"))


def filled(page: str, results: Path) -> str:
    """The page with the tables there are; a section without results keeps what it has."""

    def section(match: re.Match[str]) -> str:
        table = results / f"{match[2]}.md"
        return f"{match[1]}{table.read_text().strip()}\n{match[3]}" if table.exists() else match[0]

    return _SECTION.sub(section, page)


def draw_profile(lines: Sequence[dict[str, Any]], target: Path) -> None:
    """Share of the files on which a solver is at most τ times as slow as the fastest (Dolan & Moré 2002)."""
    taus, shares = performance_profile(lines)
    figure, axes = _axes()
    for number, (solver, share) in enumerate(shares.items()):
        axes.step(taus, share, _LINES[number % len(_LINES)], where="post", label=solver)
    axes.set(xscale="log", xlabel="times the seconds of the fastest, τ", ylabel="share of the files")
    axes.set(ylim=(0, 1.03), xlim=(1, taus[-1]))
    axes.legend(fontsize=8, loc="lower right")
    _save(figure, target)


def performance_profile(
    lines: Sequence[dict[str, Any]],
) -> tuple[NDArray[np.float64], dict[str, NDArray[np.float64]]]:
    """Ratios τ, and for each solver the share of the files with a ratio of at most τ."""
    solvers = list(dict.fromkeys(solver for line in lines for solver in line["by_solver"]))
    seconds = np.array(
        [[line["by_solver"].get(solver) or np.inf for solver in solvers] for line in lines],
        dtype=np.float64,
    )
    ratios = seconds / seconds.min(axis=1, keepdims=True)
    taus = np.unique(np.concatenate([[1.0], ratios[np.isfinite(ratios)]]))
    taus = np.append(taus, 1.3 * taus[-1])
    shares = (ratios[None] <= taus[:, None, None]).mean(axis=1)
    return taus, {solver: shares[:, column] for column, solver in enumerate(solvers)}


def draw_roofline(machine: dict[str, Any], kernels: Sequence[dict[str, Any]], target: Path) -> None:
    """Flops a second against flops a byte, on one thread, under what the machine can do (Williams 2009)."""
    roof = machine["by_threads"]["1"]
    figure, axes = _axes()
    intensity = np.geomspace(0.05, 100, 200)
    for precision, style in (("double", "-"), ("single", "--")):
        limit = np.minimum(intensity * roof["bytes_read"], roof[f"flops_{precision}"])
        axes.plot(intensity, limit / 1e9, style, color="0.4", label=f"{precision} precision")
    for kernel in kernels:
        at = kernel["flops"] / kernel["bytes"]
        rate = kernel["flops"] / kernel["ns"]
        mark = "o" if kernel["precision"] == "double" else "s"
        axes.plot(at, rate, mark, color="C0" if mark == "o" else "C1")
        share = 1e9 * rate / min(at * roof["bytes_read"], roof[f"flops_{kernel['precision']}"])
        axes.annotate(f" {kernel['kernel']} {100 * share:.0f} %", (at, rate), fontsize=7, va="center")
    axes.set(xscale="log", yscale="log", xlabel="flops a byte", ylabel="Gflop/s, one thread")
    axes.legend(fontsize=8, loc="lower right")
    _save(figure, target)


def _axes() -> tuple[Any, Any]:
    import matplotlib as mpl

    mpl.use("Agg")
    mpl.rcParams["svg.hashsalt"] = "sfmcpp"  # the same picture, the same bytes
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
    axes.grid(alpha=0.3)
    return figure, axes


def _save(figure: Any, target: Path) -> None:
    figure.savefig(target, metadata={"Date": None})
    print(f"drawn: {target}")


if __name__ == "__main__":
    main()
