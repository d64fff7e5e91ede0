#!/usr/bin/env bash
# Usage: make_stub.sh PYTHON OUTPUT: writes the type stub of the sfmcpp._core that PYTHON imports to OUTPUT.
set -euo pipefail
python=$1 output=$2

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"$python" -m pybind11_stubgen sfmcpp._core --exit-code --output-dir "$folder"
# Texts such as the version and the instruction set belong to one build, not to the interface.
sed -E 's/^(\w+: str) = .*/\1/' "$folder/sfmcpp/_core.pyi" >"$output"
# The options of a solve as keywords, for type checkers and editors.
"$python" - >>"$output" <<'PYTHON'
from sfmcpp._core import SOLVE_OPTIONS


def literal(names: list[str]) -> str:
    return f"typing.Literal[{', '.join(map(repr, names))}]"


print("class SolveKeywords(typing.TypedDict, total=False):")
for option in SOLVE_OPTIONS:
    names = [name for name, _ in option.choices]
    other = f" | {literal([option.unset])}" if option.unset else " | None" if option.optional else ""
    other += " | LossTable" if option.name == "loss" else ""
    print(f"    {option.name}: {literal(names) if names else option.type}{other}")
PYTHON
