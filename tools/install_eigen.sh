#!/usr/bin/env bash
# Usage: install_eigen.sh: installs the headers of Eigen from its sources, where wheels are built and no package has them.
set -euo pipefail
version=3.4.0
sha256=8586084f71f9bde545ee7fa6d00288b264a2b7ac3607b974e54d13e7162c1c72

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
curl --fail --location --silent --show-error --output "$folder/eigen.tar.gz" \
  "https://gitlab.com/libeigen/eigen/-/archive/$version/eigen-$version.tar.gz"
(cd "$folder" && echo "$sha256  eigen.tar.gz" | sha256sum --check --quiet && tar -xzf eigen.tar.gz)
cmake -S "$folder/eigen-$version" -B "$folder/build" -DEIGEN_BUILD_DOC=OFF -DBUILD_TESTING=OFF >/dev/null
$([[ -w /usr/local ]] || echo sudo) cmake --install "$folder/build" >/dev/null
