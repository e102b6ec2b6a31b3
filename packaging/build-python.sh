#!/bin/sh
# The Python package, with the library inside its extension, into $PYTHON's environment.
# Types are asked of the extension itself, which starts MPI: not on a builder.
set -eu
"${PYTHON:-python3}" -m pip install --no-deps --no-build-isolation -vv \
  -C cmake.define.MORTAR_UNITY=ON -C cmake.define.MORTAR_STUBS=OFF "$@" "$(dirname "$0")/.."
