#!/bin/sh
# The C++ library and its CMake package, into $PREFIX. More arguments are CMake's.
set -eu
cmake -G Ninja -S "$(dirname "$0")/.." -B build-library -DCMAKE_BUILD_TYPE=Release \
  -DCMAKE_INSTALL_PREFIX="$PREFIX" -DCMAKE_INSTALL_LIBDIR=lib -DMORTAR_PYTHON=OFF -DMORTAR_UNITY=ON "$@"
cmake --build build-library
cmake --install build-library
