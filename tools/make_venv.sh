#!/usr/bin/env bash
# Usage: make_venv.sh FOLDER: a virtual environment made by $PYTHON (default python3), which must be 3.10 or newer.
set -euo pipefail
folder=$1
python=${PYTHON:-python3}
here=$(dirname "$0")

fail() { echo "sfmcpp: $*" >&2; exit 1; }

make_venv() { "$python" -m venv --clear "$folder" &>/dev/null; }

has_headers() { "$python" -c 'import os, sysconfig as s; os.stat(s.get_path("include") + "/Python.h")' 2>/dev/null; }

[[ $python != python3 ]] || command -v python3 >/dev/null || "$here/install_packages.sh" python3
command -v "$python" >/dev/null || fail "no program $python; choose another: make PYTHON=/path/to/python"
"$python" -c 'import sys; sys.exit(sys.version_info < (3, 10))' ||
  fail "$python is $("$python" --version 2>&1), must be 3.10 or newer; choose another: make PYTHON=/path/to/python"

# Debian splits Python; the Python of pyenv and the like is complete, and then needs no Debian package.
has_headers || "$here/install_packages.sh" python3-dev
has_headers || fail "$python has no Python.h; install the development files of $("$python" --version)"
make_venv || "$here/install_packages.sh" python3-venv
[[ -x $folder/bin/pip ]] || make_venv || fail "'$python -m venv $folder' fails"
