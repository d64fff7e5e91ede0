#!/usr/bin/env bash
# Usage: install_package.sh VENV BUILD_FOLDER: builds sfmcpp and installs it with all its extras into VENV.
# Without build isolation pybind11 stays in one place, so that only what changed is compiled again. The C++ tests
# and benchmarks are set up in the same folder, for `cmake --build`, so that the core is compiled once for all.
set -euo pipefail
cd "$(dirname "$0")/.."
pip=("$1/bin/python" -m pip --disable-pip-version-check --quiet)
settings=(
  build-dir="$2" build.targets=_core cmake.define.SFMCPP_BUILD_TESTS=ON cmake.define.SFMCPP_BUILD_BENCH=ON
  cmake.define.SFMCPP_WARNINGS_AS_ERRORS="${SFMCPP_WARNINGS_AS_ERRORS:-OFF}"
)

fail() { echo "sfmcpp: $*" >&2; exit 1; }

"${pip[@]}" install scikit-build-core pybind11 || fail "pip could not install scikit-build-core and pybind11 into $1"
# Minutes where all is new, in which pip says nothing.
tell_progress() {
  while sleep 20; do
    objects=($(ninja -C "$2" -t commands _core 2>/dev/null | grep -oE 'cpp/[^ ]+\.o -c ' | cut -d ' ' -f 1 || true))
    done=$(cd "$2" 2>/dev/null && ls /dev/null "${objects[@]}" 2>/dev/null | grep -c '\.o$' || true)
    (( ${#objects[@]} == 0 )) || echo "sfmcpp: ${done:-0} of ${#objects[@]} files compiled after $SECONDS s"
  done
}
echo "sfmcpp: compiling the C++ core and installing the package with its extras into $1: about three minutes where all is new"
tell_progress "$@" &
trap "kill $!" EXIT
"${pip[@]}" install --no-build-isolation "${settings[@]/#/--config-settings=}" '.[all,dev]' ||
  fail "pip could not build and install sfmcpp into $1"
