#!/usr/bin/env bash
# Builds everything and runs all tests: GoogleTest, then pytest against the installed package.
set -euo pipefail
cd "$(dirname "$0")/.."
./scripts/install.sh view,test,dev
bin=$(realpath "${VSR2_VENV:-.venv}")/bin
cmake --preset release >/dev/null
cmake --build --preset release
ctest --preset release --output-on-failure
"$bin/ruff" check .
"$bin/ruff" format --check .
"$bin/mypy"
"$bin/python" -m pytest --numprocesses auto --dist worksteal "$@"
