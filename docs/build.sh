#!/bin/sh
# Makes the documentation in output/docs/html; ./run sh docs/build.sh [OPTION FOR sphinx-build...]
#
# Warnings are errors. What Doxygen reads out of the headers is in output/docs/doxygen. All pages
# are made anew, since Sphinx does not know which of them follow from which sources.
set -eu
cd "$(dirname "$0")/.."
if ! command -v doxygen >/dev/null || [ ! -d /usr/share/javascript/katex ] ||
  ! python3 -c 'import breathe, furo, myst_parser' 2>/dev/null; then
  echo "docs/build.sh: doxygen, Sphinx or KaTeX is missing: call MORTAR_SUITE=trixie ./run sh $0" >&2
  exit 1
fi
out=$PWD/output/docs
mkdir -p "$out/doxygen"
(cat docs/Doxyfile && echo "OUTPUT_DIRECTORY = \"$out/doxygen\"") | doxygen -
export MORTAR_DOXYGEN="$out/doxygen/xml"
python3 -m sphinx -q -E -a -W --keep-going -n -b html -d "$out/doctrees" "$@" docs "$out/html"
echo "output/docs/html/index.html"
