"""Where the runs of an experiment start: perturbed scenes and real problems."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import sfmcpp
from experiments.description import Experiment, Row
from experiments.real_problems import problem_name, read_real_problem
from sfmcpp import Problem


@dataclass(frozen=True)
class Start:
    """A problem to solve, never changed by it.

    Attributes
    ----------
    name : str
        Of the file, or of the scene with its level of noise.
    seed : int
        Of the scene and its noise; 0 for real problems.
    problem : Problem
        At its initial state.
    """

    name: str
    seed: int
    problem: Problem


def synthetic_starts(experiment: Experiment) -> Iterator[Start]:
    """Every seed of every level of noise in every camera model."""
    for noise in experiment.noise:
        for seed in experiment.seeds:
            problem = noisy_scene(experiment, noise, seed)
            for model in experiment.camera_models:
                yield Start(_scene_name(experiment, noise), seed, in_model(problem, model))


def real_starts(experiment: Experiment) -> Iterator[Start]:
    """Every file, as it is and as projective, as the experiment asks."""
    for file in experiment.files:
        yield Start(problem_name(file), 0, read_real_problem(file))
    for file in experiment.projective_files:
        yield Start(problem_name(file), 0, sfmcpp.as_projective(read_real_problem(file)))


def noisy_scene(experiment: Experiment, noise: Row, seed: int) -> Problem:
    """Make the scene of the experiment, moved away from the truth."""
    return sfmcpp.perturb(true_scene(experiment, seed), **noise, seed=seed)


def true_scene(experiment: Experiment, seed: int, kind: str | None = None) -> Problem:
    """Make the scene of the experiment with the true cameras and points, of another `kind` if given."""
    arguments = dict(experiment.scene)
    own = arguments.pop("kind", None)
    return sfmcpp.SCENES[kind or own](**arguments, seed=seed)


def in_model(problem: Problem, camera_model: str) -> Problem:
    """The problem as projective if that is asked for, else as it is."""
    return sfmcpp.as_projective(problem) if camera_model == "projective" else problem


def _scene_name(experiment: Experiment, noise: Row) -> str:
    return f"{experiment.scene['kind']}, {' '.join(f'{name}={value:g}' for name, value in noise.items())}"
