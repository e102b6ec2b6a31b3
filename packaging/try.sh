#!/bin/sh
# What a release must pass: the packages, made from the source distribution alone, in a folder of
# their own. Needs an environment with DOLFINx: ./run packaging/try.sh
set -eu
project=$(cd "$(dirname "$0")/.." && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
step() { printf '\n=== %s\n' "$*"; }
# The build that `./run` has made must not help
unset PYTHONPATH

step 'source distribution'
python3 -m venv --without-pip --system-site-packages "$work/venv" # pip is that of the system
(cd "$project" && python3 -c "
from scikit_build_core.build import build_sdist
print(build_sdist('$work'))")
tar -xzf "$work"/dolfinx_mortar-*.tar.gz -C "$work"
source=$(echo "$work"/dolfinx_mortar-*/)

step 'Python package in a virtual environment'
PYTHON=$work/venv/bin/python3 "$source/packaging/build-python.sh"
cd "$work"
"$work/venv/bin/python3" - "$source/README.md" <<'PYTHON'
import pathlib, re, sys
import dolfinx_mortar
assert "/venv/" in dolfinx_mortar.__file__, dolfinx_mortar.__file__
(code,) = re.findall(r"```python\n(.*?)```", pathlib.Path(sys.argv[1]).read_text(), re.DOTALL)
names = {}
exec(compile(code, "README.md", "exec"), names)
print(names["problem"].report())
PYTHON

step 'C++ library and demo'
PREFIX=$work/prefix "$source/packaging/build-library.sh"
cmake -G Ninja -S "$source/demos/cpp" -B "$work/demo" -DCMAKE_PREFIX_PATH="$work/prefix"
cmake --build "$work/demo"
for ranks in 1 2; do
  mpirun -n $ranks "$work/demo/matrices"
  (cd "$work" && mpirun -n $ranks "$work/demo/contact")
done
step 'done'
