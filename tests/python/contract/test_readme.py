"""The Python examples of the README run, in their order, as one session of a reader."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

README = Path(__file__).resolve().parents[3] / "README.md"
# "```python real" marks a block that reads files of the real data, by their bare names.
BLOCK = re.compile(r"^```python( real)?\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def blocks(text: str, *, real: bool) -> list[str]:
    """Python blocks of a Markdown text, in order; those that need real data only if `real`."""
    return [code for mark, code in BLOCK.findall(text) if real or not mark]


def run_session(codes: list[str]) -> None:
    """Run the blocks one after the other with the same names in sight."""
    names: dict[str, object] = {"__name__": "__main__"}
    for number, code in enumerate(codes, start=1):
        exec(compile(code, f"README.md, Python block {number}", "exec"), names)


def test_python_blocks_of_the_readme_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    codes = blocks(README.read_text(encoding="utf-8"), real=False)
    assert codes
    run_session(codes)


@pytest.mark.real
def test_python_blocks_of_the_readme_run_on_real_data(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, data_dir: Path
) -> None:
    text = README.read_text(encoding="utf-8")
    if blocks(text, real=True) == blocks(text, real=False):
        pytest.skip("no Python block of the README reads real data")
    for path in [*(data_dir / "bal").iterdir(), *(data_dir / "kitti_tracks").iterdir()]:
        (tmp_path / path.name).symlink_to(path)
    (tmp_path / "photos").mkdir()
    for path in (data_dir / "kermit").glob("*.jpg"):
        (tmp_path / "photos" / path.name).symlink_to(path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    run_session(blocks(text, real=True))


def test_blocks_are_found_in_order_and_run_with_the_same_names() -> None:
    text = (
        "```python\nx = 1\n```\n```sh\nmake\n```\n```python real\nx = 0\n```\n```python\nassert x == 1\n```\n"
    )
    assert blocks(text, real=False) == ["x = 1\n", "assert x == 1\n"]
    run_session(blocks(text, real=False))
    with pytest.raises(AssertionError):
        run_session(blocks(text, real=True))
