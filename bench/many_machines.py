"""On paper: an iteration of conjugate gradients on 16 to 1,024 ranks, from measured bytes and known networks.

``python bench/many_machines.py PROBLEM… -o docs/many-machines.png`` cuts each problem as the ranks would,
counts the cameras that the points of a rank touch, and draws what that means; it prints the numbers drawn.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np

import sfmcpp
from sfmcpp.ba.partition import partition_points

mpl.use("Agg")
import matplotlib.pyplot as plt

RANKS = np.array([16, 32, 64, 128, 256, 512, 1024])

# github.com/tkonolige/multigrid_bundle_adjustment, block Jacobi: cameras, and seconds by ranks.
PUBLISHED_CAMERAS = 98_925
PUBLISHED = {16: 131.6e-3, 32: 73.5e-3, 64: 47.9e-3}

# What all ranks together do for a camera [s]. Of the published runs, S·x: slope of the first two over 1/N. Of
# this package, all of an iteration with clusters: 3.6 ms on city 3,000 with two threads of a quiet machine.
WORK_PUBLISHED = (131.6e-3 - 73.5e-3) * 32 / PUBLISHED_CAMERAS
WORK_HERE = 3.6e-3 * 2 / 3_000

# What every rank does for every camera where vectors are on all: 18 passes over nine doubles, and a 9×9 block
# of the preconditioner. Where they are cut, as here: the product is cleared and read, with owners and marks.
WHOLE_BYTES = 18 * 9 * 8 + 81 * 8
CUT_BYTES = 9 * (3 * 8 + 4) + 3
# How fast a rank reads, sharing a machine's memory with others.
MEMORY_BYTES_PER_S = 10e9
# Nine doubles for each camera, there and back: to be summed in shares, or to the rank that it belongs to.
SENT_BYTES = 2 * 9 * 8


@dataclass(frozen=True)
class Network:
    """Nominal bandwidth [bytes/s] and latency [s] of a network."""

    name: str
    bytes_per_s: float
    latency_s: float


NETWORKS = (Network("InfiniBand EDR", 12.5e9, 1e-6), Network("10 Gb Ethernet", 1.25e9, 20e-6))


def seconds(
    cameras: float, ranks: np.ndarray, work: float, network: Network, touched: np.ndarray | None = None
) -> np.ndarray:
    """Model of one iteration [s]; vectors are cut if it is told which share of the cameras a rank touches."""
    parallel = work * cameras / ranks
    of_all = cameras * (WHOLE_BYTES if touched is None else CUT_BYTES) / MEMORY_BYTES_PER_S
    passed_on = (ranks - 1) / ranks if touched is None else touched - 1 / ranks
    sent = cameras * passed_on * SENT_BYTES / network.bytes_per_s
    return parallel + of_all + sent + 2 * (ranks - 1) * network.latency_s


def touched(problem: sfmcpp.Problem) -> np.ndarray:
    """Mean share of the cameras that the points of a rank are seen by, for each number of ranks."""
    shares = []
    for count in RANKS:
        part = partition_points(problem, int(count))[problem.point_index].astype(np.int64)
        pairs = np.unique(part * problem.num_cameras + problem.camera_index)
        shares.append(len(pairs) / count / problem.num_cameras)
    return np.array(shares)


def draw_model(axes: plt.Axes, cameras: int, share: np.ndarray) -> None:
    """Milliseconds of an iteration over the ranks, of both networks."""
    for network, color in zip(NETWORKS, ("C0", "C3"), strict=True):
        whole = seconds(cameras, RANKS, WORK_HERE, network)
        cut = seconds(cameras, RANKS, WORK_HERE, network, share)
        print(f"{cameras:,} cameras, {network.name}: vectors on all ranks", np.round(1e3 * whole, 1))
        print(f"{cameras:,} cameras, {network.name}: cut, as here        ", np.round(1e3 * cut, 1))
        axes.loglog(RANKS, 1e3 * whole, "--", color=color, label=f"vectors on all ranks, {network.name}")
        axes.loglog(RANKS, 1e3 * cut, "o-", color=color, ms=3, label=f"cut, as here, {network.name}")
    axes.loglog(RANKS, 1e3 * WORK_HERE * cameras / RANKS, ":", color="0.5", label="work alone, shared evenly")
    axes.set(title=f"{cameras:,} cameras", xlabel="ranks", ylabel="an iteration [ms]")
    axes.set_xticks(RANKS, map(str, RANKS))
    axes.minorticks_off()


def draw_check(axes: plt.Axes) -> None:
    """The model with the work of the published runs, beside these."""
    modelled = seconds(PUBLISHED_CAMERAS, RANKS, WORK_PUBLISHED, NETWORKS[0])
    print("published", PUBLISHED, "modelled", np.round(1e3 * modelled, 1))
    axes.loglog(RANKS, 1e3 * modelled, "o-", ms=3, label="model")
    axes.loglog([*PUBLISHED], [1e3 * s for s in PUBLISHED.values()], "k*", ms=9, label="published")
    axes.set(
        title=f"{PUBLISHED_CAMERAS:,} cameras, published runs", xlabel="ranks", ylabel="an iteration [ms]"
    )
    axes.set_xticks(RANKS, map(str, RANKS))
    axes.minorticks_off()
    axes.legend(frameon=False, fontsize=7)


def main() -> None:
    """Print and draw."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("problems", nargs="+", type=Path, metavar="PROBLEM")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="PNG")
    arguments = parser.parse_args()
    figure, (check, small, large, cut) = plt.subplots(1, 4, figsize=(15, 3.6), layout="constrained")
    draw_check(check)
    for path in arguments.problems:
        problem = sfmcpp.read(path)
        share = touched(problem)
        print(f"{problem.num_cameras:,} cameras: a rank touches", np.round(share, 4))
        cut.loglog(RANKS, share, "o-", ms=3, label=f"{problem.num_cameras:,} cameras")
    draw_model(small, 100_000, share)
    draw_model(large, 1_000_000, share)
    small.legend(frameon=False, fontsize=6)
    cut.set(title="cameras that the points of a rank touch", xlabel="ranks", ylabel="share of all")
    cut.set_xticks(RANKS, map(str, RANKS))
    cut.minorticks_off()
    cut.legend(frameon=False, fontsize=7)
    figure.savefig(arguments.output, dpi=110)


if __name__ == "__main__":
    main()
