"""No argument of a public function, however odd, comes out as anything but an error of the package."""

from __future__ import annotations

import inspect
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import odd_calls
import sfmcpp
from sfmcpp.errors import SfmcppError
from test_public_docs import public_names

ODD = (
    None,
    3,
    -1,
    float("nan"),
    "odd",
    b"odd",
    [],
    {},
    [[1], [1, 2]],
    object(),
    1j,
    10**30,
    np.full((3, 3), np.nan),
    np.zeros((2, 2, 2, 2)),
)
# These take seconds, are abstract, or need files or a run to speak of.
LEFT_OUT = (
    "sfmcpp.diagnose",
    "sfmcpp.doctor.",
    "sfmcpp.photo_collection",
    "sfmcpp.sfm.",
    "sfmcpp.slam.FrameSource",
    "sfmcpp.slam.run",
    "sfmcpp.sources.",
    "sfmcpp.study.plotting",
)


def sound_call(name: str, function: Any) -> dict[str, Any] | None:
    """Arguments that do, by name; None if they are not known here."""
    try:
        parameters = inspect.signature(function).parameters.values()
    except ValueError:
        return None
    needed = [p.name for p in parameters if p.default is p.empty and p.kind is not p.VAR_KEYWORD]
    known = {**odd_calls.BY_NAME, **odd_calls.BY_FUNCTION.get(name, {})}
    chosen = [
        *needed,
        *odd_calls.BY_FUNCTION.get(name, {}),
        *({"num_cameras", "num_points"} & parameters_of(function)),
    ]
    return {name: known[name] for name in chosen} if all(name in known for name in needed) else None


def parameters_of(function: Any) -> set[str]:
    kinds = (inspect.Parameter.VAR_KEYWORD, inspect.Parameter.VAR_POSITIONAL)
    return {p.name for p in inspect.signature(function).parameters.values() if p.kind not in kinds}


SOUND_CALLS = {
    name: (function, arguments)
    for name, function in public_names().items()
    if not name.startswith(LEFT_OUT)
    if (arguments := sound_call(name.removeprefix("sfmcpp."), function)) is not None
}


@pytest.mark.parametrize("name", SOUND_CALLS)
def test_an_odd_argument_is_taken_or_refused_by_name(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    function, sound = SOUND_CALLS[name]
    monkeypatch.chdir(tmp_path)
    raw = []
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        function(**sound)
        for argument in sorted(parameters_of(function)):
            for odd in ODD:
                try:
                    function(**{**sound, argument: odd})
                except SfmcppError:
                    continue
                except Exception as error:
                    raw.append(f"{argument} = {odd!r}: {type(error).__name__}: {error}")
    assert not raw


def test_what_is_called_is_most_of_what_is_public() -> None:
    assert len(SOUND_CALLS) > 100


def test_missing_and_unknown_arguments_stay_type_errors() -> None:
    with pytest.raises(TypeError):
        sfmcpp.as_projective()  # type: ignore[call-arg]
    with pytest.raises(TypeError):
        sfmcpp.perturb(odd_calls.SCENE, seed=0, sigma=1.0)  # type: ignore[call-arg]
