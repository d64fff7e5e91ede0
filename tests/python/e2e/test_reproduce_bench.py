"""`bench/reproduce.py`: a trial leaves page and results alone; what is missing is told at the start."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

BENCH = Path(__file__).resolve().parents[3] / "bench"
MACHINE = {"by_threads": {"1": {"flops_double": 5e10, "flops_single": 1e11, "bytes_read": 2e10}}}
LINES = [{"by_solver": {"ours": 1.0, "theirs": 4.0}}]


@pytest.fixture
def reproduce(monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    monkeypatch.syspath_prepend(str(BENCH))
    before = set(sys.modules)
    import reproduce

    yield reproduce
    for name in set(sys.modules) - before:
        if name.split(".")[0] in ("reproduce", "scaling"):
            del sys.modules[name]


@pytest.fixture
def build(tmp_path: Path) -> Path:
    """A folder with the programs of a build; the probe tells what MACHINE has."""
    folder = tmp_path / "build"
    programs = folder / "bench" / "cpp"
    programs.mkdir(parents=True)
    for name in ("sfmcpp_stored_w", "sfmcpp_probe"):
        (programs / name).write_text(f"#!/bin/sh\necho '{json.dumps(MACHINE)}'\n")
        (programs / name).chmod(0o755)
    return folder


def measure_nothing(reproduce: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let every program write results at once; only the one that fills in the page is the true one."""
    fill_in = reproduce.run
    from scaling.cases import Case
    from scaling.results import commit

    def run(program: str, *arguments: str) -> None:
        if program == "tables.py":
            return fill_in(program, *arguments)
        out = Path(arguments[arguments.index("--out") + 1])
        written = {
            "scale.py": out / "scale.md",
            "peers/whole_set.py": out / commit() / "set.md",
            "stored_w.py": out.with_suffix(".md"),
        }[program]
        written.parent.mkdir(parents=True, exist_ok=True)
        written.write_text(f"| by {program} |\n")
        written.with_suffix(".json").write_text(json.dumps(LINES))

    monkeypatch.setattr(reproduce, "run", run)
    monkeypatch.setattr(Case, "path", lambda self, folder: folder / self.name)


def test_a_trial_fills_in_a_copy_of_the_page(
    reproduce: ModuleType, build: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("matplotlib")
    measure_nothing(reproduce, monkeypatch)
    kept = [BENCH.parent / "docs" / "benchmarks.md", *(BENCH / "results").iterdir()]
    before = {path: path.read_bytes() for path in kept}
    reproduce.main(["--quick", "--build", str(build), "--work", str(tmp_path / "work")])
    assert {path: path.read_bytes() for path in kept} == before
    assert set((BENCH / "results").iterdir()) == set(kept[1:])
    trial = tmp_path / "work" / "quick"
    page = (trial / "benchmarks.md").read_text()
    for program in ("scale.py", "peers/whole_set.py", "stored_w.py"):
        assert f"| by {program} |" in page
    assert f"- sfmcpp: {reproduce.versions().split(': ')[1].split(',')[0]}" in page
    assert (trial / "performance-profile.svg").exists()
    assert (trial / "roofline.svg").exists()


@pytest.mark.parametrize("absent", ["sfmcpp_stored_w", "sfmcpp_probe"])
def test_a_build_without_its_programs_is_refused_before_hours_of_measuring(
    reproduce: ModuleType, build: Path, absent: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (build / "bench" / "cpp" / absent).unlink()
    with pytest.raises(SystemExit) as stopped:
        reproduce.parse(["--build", str(build)])
    assert stopped.value.code == 2
    assert f"{build}: no {absent} in bench/cpp" in capsys.readouterr().err


def test_more_files_for_the_set_must_be_there(
    reproduce: ModuleType, build: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        reproduce.parse(["--build", str(build), "--extra", "nowhere.txt"])
    assert "--extra: no such file: nowhere.txt" in capsys.readouterr().err
