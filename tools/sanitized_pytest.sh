#!/usr/bin/env bash
# Usage: sanitized_pytest.sh asan|tsan PYTHON FOLDER [PYTEST_ARGUMENT…]: runs tests with the _core of FOLDER, which
# was built with that sanitizer, in place of an installed one.
set -euo pipefail
sanitizer=$1 python=$2 build=$3
shift 3
cd "$(dirname "$0")/.."

# The package as it stands in the sources, beside that _core.
package=$build/package/sfmcpp
rm -rf "$package" && mkdir -p "$package"
find "$PWD/python/sfmcpp" -mindepth 1 -maxdepth 1 -not -name '_core*.so' -not -name __pycache__ -exec ln -s {} "$package" \;
ln -s "$PWD/$build"/_core*.so "$package"

# Python itself is not sanitized: the runtime must be there before it starts, and libstdc++ before that looks for its throw.
runtime="$("${CXX:-g++}" -print-file-name=lib$sanitizer.so) $("${CXX:-g++}" -print-file-name=libstdc++.so)"
# Python keeps much to its end and calls that a leak: the C++ tests look for ours. With malloc of its own it would hide what
# is read or written beyond its objects.
export ASAN_OPTIONS=detect_leaks=0:allocator_may_return_null=1 UBSAN_OPTIONS=print_stacktrace=1 PYTHONMALLOC=malloc
export PYTHONPATH="$PWD/$build/package" PYTHONDONTWRITEBYTECODE=1
LD_PRELOAD=$runtime "$python" -m pytest -q -p no:cacheprovider "$@"
