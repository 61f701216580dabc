#!/usr/bin/env bash
# Builds and runs the C++ tests under sanitizers: `address` (with undefined behaviour) or `thread`.
set -euo pipefail
cd "$(dirname "$0")/.."
preset=${1:-address}
cmake --preset "$preset" >/dev/null
cmake --build --preset "$preset"
ctest --preset "$preset" --output-on-failure
