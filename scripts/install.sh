#!/usr/bin/env bash
# Installs what VSR2 needs on a bare Debian 12 machine: system packages, then the package and its
# extras into a virtual environment (VSR2_VENV, default .venv). Other scripts call it.
set -euo pipefail
cd "$(dirname "$0")/.."

packages=(build-essential cmake ninja-build python3-dev python3-venv libbullet-dev libeigen3-dev)
extras=${1:-view}
case ",$extras," in
  *,test,*) packages+=(libgtest-dev chromium chromium-driver) ;;
esac

missing=()
for package in "${packages[@]}"; do
  dpkg-query -W -f '${Status}' "$package" 2>/dev/null | grep -q '^install ok installed' || missing+=("$package")
done
if ((${#missing[@]})); then
  echo "Installing Debian packages: ${missing[*]}"
  as_root=()
  if [ "$(id -u)" != 0 ]; then
    command -v sudo >/dev/null || {
      echo "These packages are missing: ${missing[*]}. Install them as root: apt-get install ${missing[*]}" >&2
      exit 1
    }
    as_root=(sudo)
  fi
  "${as_root[@]}" apt-get update -qq
  DEBIAN_FRONTEND=noninteractive "${as_root[@]}" apt-get install -y -qq --no-install-recommends "${missing[@]}" >/dev/null
fi

venv=${VSR2_VENV:-.venv}
if [ ! -x "$venv/bin/python" ]; then
  echo "1 of 3: making the virtual environment $venv"
  /usr/bin/python3 -m venv "$venv"
fi
pip=("$venv/bin/python" -m pip --disable-pip-version-check)
echo "2 of 3: bringing pip up to date"
"${pip[@]}" install --quiet --upgrade pip
echo "3 of 3: fetching what [$extras] needs and building the native core: minutes, on a busy machine ten or more"
# pip's own lines, one a package and one a stage: with --quiet nothing would be seen of these minutes.
"${pip[@]}" install --progress-bar off ".[$extras]"
