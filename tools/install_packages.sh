#!/usr/bin/env bash
# Usage: install_packages.sh PACKAGE...: installs those Debian packages that are missing.
set -euo pipefail

is_installed() { [[ "$(dpkg-query --show --showformat='${db:Status-Status}' "$1" 2>/dev/null)" == installed ]]; }

as_root() { if [[ $(id -u) == 0 ]]; then "$@"; else sudo "$@"; fi; }

fail() { echo "sfmcpp: $*" >&2; exit 1; }

if ! command -v dpkg-query >/dev/null; then
  echo "sfmcpp: not a Debian system, so nothing is installed; needed are the equivalents of: $*" >&2
  exit 0
fi

missing=()
for package in "$@"; do
  is_installed "$package" || missing+=("$package")
done
[[ ${#missing[@]} == 0 ]] && exit 0

if [[ $(id -u) != 0 ]] && ! command -v sudo >/dev/null; then
  fail "as root, run: apt-get install ${missing[*]}"
fi
echo "sfmcpp: installing ${missing[*]}"
as_root apt-get update -qq || echo "sfmcpp: apt-get update failed, going on with the package lists at hand" >&2
as_root env DEBIAN_FRONTEND=noninteractive apt-get install -qq --no-install-recommends "${missing[@]}" >/dev/null ||
  fail "apt-get could not install ${missing[*]}"
