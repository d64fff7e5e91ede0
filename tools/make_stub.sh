#!/usr/bin/env bash
# Usage: make_stub.sh PYTHON OUTPUT: writes the type stub of the sfmcpp._core that PYTHON imports to OUTPUT.
set -euo pipefail
python=$1 output=$2

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"$python" -m pybind11_stubgen sfmcpp._core --exit-code --output-dir "$folder"
cp "$folder/sfmcpp/_core.pyi" "$output"
