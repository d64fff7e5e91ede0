"""Parts that ranks bring and decisions that they take together, on ranks that are threads."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sfmcpp import CheckpointFolder, DatasetError, Problem, circle_scene, solve
from sfmcpp.ba.checkpoints import RankCheckpoints, facts_of_run
from sfmcpp.ba.parts import OwnParts, gathered, part_of
from sfmcpp.ba.ranks import Ranks
from sfmcpp.model.arrays import FloatArray
from thread_ranks import on_thread_ranks


def own_parts(count: int) -> list[Problem]:
    problem = circle_scene(6, 40, pixel_sigma_px=0.5, seed=0)
    return [part_of(problem, np.arange(rank, 40, count)).problem for rank in range(count)]


def joined(parts: list[Problem]) -> Problem:
    whole = on_thread_ranks(len(parts), lambda ranks: gathered(OwnParts(parts[ranks.rank], ranks), ranks))[0]
    assert whole is not None
    return whole


@pytest.mark.parametrize("with_sigmas", [0, 1])
def test_parts_with_and_without_sigmas_are_joined_with_those_of_all(with_sigmas: int) -> None:
    parts = own_parts(2)
    sigmas = [np.ones(part.num_observations) for part in parts]
    sigmas[with_sigmas][:] = 3.0
    parts[with_sigmas] = replace(parts[with_sigmas], sigma_px=sigmas[with_sigmas])
    whole = joined(parts)
    assert whole.sigma_px is not None
    np.testing.assert_array_equal(whole.sigma_px, np.concatenate(sigmas))
    assert whole.covariance_px2 is None


def test_parts_with_sigmas_and_covariances_are_joined_with_covariances() -> None:
    parts = own_parts(3)
    counts = [part.num_observations for part in parts]
    covariances: list[FloatArray] = [
        np.tile(matrix, (count, 1, 1))
        for matrix, count in zip((np.eye(2), 4 * np.eye(2), [[2.0, 1.0], [1.0, 3.0]]), counts, strict=True)
    ]
    parts[1] = replace(parts[1], sigma_px=np.full(counts[1], 2.0))
    parts[2] = replace(parts[2], covariance_px2=covariances[2])
    whole = joined(parts)
    assert whole.covariance_px2 is not None
    np.testing.assert_array_equal(whole.covariance_px2, np.concatenate(covariances))
    assert whole.sigma_px is None


FACTS = facts_of_run("solve", problem={}, options={})


def test_checkpoints_of_which_no_rank_has_the_same_are_refused(tmp_path: Path) -> None:
    for rank, damaged in ((0, 2), (1, 1)):
        store = CheckpointFolder(tmp_path).of_rank(rank)
        store.begin()
        for sequence in (1, 2):
            store.save(FACTS | {"ranks": [rank, 2]}, lambda: {"step": np.zeros(1)})
            if sequence == damaged:
                Path(store.load().path).write_bytes(b"half of it")

    def resume(ranks: Ranks) -> None:
        with pytest.raises(DatasetError, match="no checkpoint that all ranks have whole"):
            RankCheckpoints(None, CheckpointFolder(tmp_path), lambda: dict(FACTS), 0, ranks)

    on_thread_ranks(2, resume)


class _Counted(CheckpointFolder):
    def __len__(self) -> int:
        return len(self.sequences())


def test_a_store_that_has_a_length_is_one_before_it_has_a_checkpoint(tmp_path: Path) -> None:
    problem = circle_scene(6, 40, pixel_sigma_px=0.5, seed=0)
    solve(problem.copy(), checkpoint=_Counted(tmp_path / "kept", every_s=0.0), max_iterations=1)
    assert solve(problem, resume=_Counted(tmp_path / "kept")).converged
