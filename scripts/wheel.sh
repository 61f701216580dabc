#!/usr/bin/env bash
# Builds a wheel into wheelhouse/ that carries Bullet's libraries, so that it installs without them.
set -euo pipefail
cd "$(dirname "$0")/.."
./scripts/install.sh dev
bin=$(realpath "${VSR2_VENV:-.venv}")/bin
raw=$(mktemp -d)
trap 'rm -rf "$raw"' EXIT
rm -rf wheelhouse
"$bin/python" -m build --wheel --outdir "$raw" . >/dev/null
PATH="$bin:$PATH" "$bin/auditwheel" repair --wheel-dir wheelhouse "$raw"/*.whl
ls wheelhouse/*.whl
