#!/usr/bin/env bash
# Usage: clang_tidy.sh BUILD_FOLDER JOBS: clang-tidy on all of cpp/src, with the compile commands of BUILD_FOLDER.
set -euo pipefail
cd "$(dirname "$0")/.."

[[ -f $1/compile_commands.json ]] || { echo "sfmcpp: no $1/compile_commands.json" >&2; exit 1; }

options=(
  --quiet -p "$1"
  --config-file=.clang-tidy  # named, because names that clang makes up belong to no file and would find none
  # The commands were written for g++ 12. What clang 14 lacks of it: some warnings, and two built-in
  # functions, for which these stand-ins have the right type.
  --extra-arg=-Wno-unknown-warning-option
  --extra-arg=-Wno-error
  '--extra-arg=-D__builtin_cpu_supports(level)=true'
  '--extra-arg=-D__builtin_shuffle(vector,...)=(vector)'
)
find cpp/src -name '*.cpp' -print0 | xargs -0 -n 1 -P "$2" clang-tidy "${options[@]}"
