"""What an evaluation says of itself is a line, and not its arrays."""

from __future__ import annotations

import numpy as np

from sfmcpp.model import Trajectory
from sfmcpp.study.evaluation import evaluate


def test_an_evaluation_prints_itself_in_a_line() -> None:
    poses = np.tile(np.eye(3, 4), (30, 1, 1))
    poses[:, :, 3] = np.random.default_rng(0).normal(size=(30, 3))
    truth = Trajectory(np.arange(30.0), poses)
    found = evaluate(truth, truth)
    for text in (str(found), repr(found)):
        assert text.startswith("Evaluation(30 pairs of poses, aligned with scale: mean 3-D error ")
        assert "\n" not in text
        assert len(text) < 120
