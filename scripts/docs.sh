#!/usr/bin/env bash
# Builds the site of the documentation into build/site/, without network: pages, reference from the
# docstrings, notebooks, which run. Any warning is an error: links and anchors that lead nowhere too.
set -euo pipefail
cd "$(dirname "$0")/.."
python=$(realpath -s "${VSR2_VENV:-.venv}")/bin/python
"$python" -c 'import sphinx, myst_nb' 2>/dev/null || ./scripts/install.sh view,docs
"$python" -m sphinx --quiet --fail-on-warning --keep-going -b html -c docs/_site \
  -d build/doctrees docs "${1:-build/site}"
echo "${1:-build/site}/index.html"
