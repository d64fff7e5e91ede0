"""Files and functions stay small enough to read in one sitting."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[3]
FOLDERS = ("cpp", "python", "bench", "tests", "examples")
SUFFIXES = {".py", ".cpp", ".hpp", ".h", ".cmake", ".sh"}
MAX_FILE_LINES = 400
MAX_FUNCTION_LINES = 60


def source_files(root: Path) -> Iterator[Path]:
    for folder in FOLDERS:
        yield from (p for p in sorted((root / folder).rglob("*")) if p.suffix in SUFFIXES and p.is_file())


def long_files(root: Path) -> list[str]:
    """Every source file above the budget, with its number of lines."""
    counts = {path: len(path.read_text(encoding="utf-8").splitlines()) for path in source_files(root)}
    return [f"{p.relative_to(root)}: {n} lines" for p, n in counts.items() if n > MAX_FILE_LINES]


def long_functions(root: Path) -> list[str]:
    """Every Python function above the budget; its decorators count, its docstring does not."""
    return [
        f"{path.relative_to(root)}:{node.lineno} {node.name}: {lines} lines"
        for path in source_files(root)
        if path.suffix == ".py"
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        if (lines := function_lines(node)) > MAX_FUNCTION_LINES
    ]


def function_lines(node: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    first = min([node.lineno, *(decorator.lineno for decorator in node.decorator_list)])
    return line_after(node) - first - docstring_lines(node)


def docstring_lines(node: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    return 0 if ast.get_docstring(node) is None else line_after(node.body[0]) - node.body[0].lineno


def line_after(node: ast.stmt) -> int:
    assert node.end_lineno is not None
    return node.end_lineno + 1


def function_of_lines(count: int) -> str:
    """Source of a function with that many lines and a docstring of three."""
    return 'def f(x):\n    """Add.\n\n    """\n' + "    x += 1\n" * (count - 1)


def test_every_file_is_within_its_budget() -> None:
    assert {"cpp", "python", "tests"} <= {
        p.relative_to(REPOSITORY).parts[0] for p in source_files(REPOSITORY)
    }
    assert long_files(REPOSITORY) == []


def test_every_python_function_is_within_its_budget() -> None:
    assert long_functions(REPOSITORY) == []


def test_a_file_is_too_long_from_one_line_above_the_budget(tmp_path: Path) -> None:
    folder = tmp_path / "cpp/src"
    folder.mkdir(parents=True)
    (folder / "short.cpp").write_text("int x;\n" * MAX_FILE_LINES)
    (folder / "long.cpp").write_text("int x;\n" * (MAX_FILE_LINES + 1))
    assert long_files(tmp_path) == ["cpp/src/long.cpp: 401 lines"]


def test_a_function_is_too_long_from_one_line_above_the_budget(tmp_path: Path) -> None:
    folder = tmp_path / "python"
    folder.mkdir()
    (folder / "short.py").write_text(function_of_lines(MAX_FUNCTION_LINES))
    (folder / "long.py").write_text("@decorator\n" + function_of_lines(MAX_FUNCTION_LINES))
    assert long_functions(tmp_path) == ["python/long.py:2 f: 61 lines"]
