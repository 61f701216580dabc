#!/usr/bin/env bash
# Runs the main job on embedded data and names what it wrote.
set -euo pipefail
cd "$(dirname "$0")/.."
./scripts/install.sh view
out=${1:-out/demo}
"${VSR2_VENV:-.venv}/bin/vsr2" run configs/demo.yaml --out "$out" --overwrite
echo "More: . ${VSR2_VENV:-.venv}/bin/activate, then vsr2 --help"
