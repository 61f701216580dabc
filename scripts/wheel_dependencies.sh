#!/usr/bin/env bash
# Builds what a wheel is linked with where no package has it: Bullet in double precision, static, and
# Eigen's headers, into a prefix that CMake is to search (CMAKE_PREFIX_PATH). cibuildwheel calls it.
#
#   scripts/wheel_dependencies.sh PREFIX
#
# The archives are downloaded, and checked by their SHA-256.
set -euo pipefail
prefix=${1:?give the folder to install into}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

fetch() { # FOLDER URL SHA256
  curl --fail --location --silent --show-error --retry 3 --output "$work/archive" "$2"
  if command -v sha256sum >/dev/null; then sum=$(sha256sum "$work/archive"); else sum=$(shasum -a 256 "$work/archive"); fi
  [ "${sum%% *}" = "$3" ] || { echo "$2: has another SHA-256 than $3" >&2; exit 1; }
  mkdir -p "$work/$1"
  tar -xzf "$work/archive" -C "$work/$1" --strip-components 1
}

fetch eigen https://gitlab.com/libeigen/eigen/-/archive/3.4.0/eigen-3.4.0.tar.gz \
  8586084f71f9bde545ee7fa6d00288b264a2b7ac3607b974e54d13e7162c1c72
cmake -S "$work/eigen" -B "$work/eigen-build" -DCMAKE_INSTALL_PREFIX="$prefix" -DBUILD_TESTING=OFF \
  -DEIGEN_BUILD_DOC=OFF -DCMAKE_POLICY_VERSION_MINIMUM=3.5 >/dev/null
cmake --install "$work/eigen-build" >/dev/null

# The version of Debian 12, which all tests run with. No contraction of multiply-add, as in our own
# code: it changes the last bit.
fetch bullet https://github.com/bulletphysics/bullet3/archive/3.24.tar.gz \
  6b1e987d6f8156fa8a6468652f4eaad17b3e11252c9870359e5bca693e35780b
cmake -S "$work/bullet" -B "$work/bullet-build" -DCMAKE_INSTALL_PREFIX="$prefix" -DCMAKE_BUILD_TYPE=Release \
  -DCMAKE_POSITION_INDEPENDENT_CODE=ON -DCMAKE_CXX_FLAGS=-ffp-contract=off -DCMAKE_POLICY_VERSION_MINIMUM=3.5 \
  -DUSE_DOUBLE_PRECISION=ON -DINSTALL_LIBS=ON -DBUILD_SHARED_LIBS=OFF -DBUILD_BULLET2_DEMOS=OFF \
  -DBUILD_CPU_DEMOS=OFF -DBUILD_OPENGL3_DEMOS=OFF -DBUILD_EXTRAS=OFF -DBUILD_UNIT_TESTS=OFF -DBUILD_BULLET3=OFF \
  -DBUILD_PYBULLET=OFF -DBUILD_ENET=OFF -DBUILD_CLSOCKET=OFF >/dev/null
cmake --build "$work/bullet-build" --parallel >/dev/null
cmake --install "$work/bullet-build" >/dev/null
# The names that Debian gives the double-precision libraries, by which CMakeLists.txt finds them.
for library in BulletDynamics BulletCollision LinearMath; do
  mv "$prefix/lib/lib$library.a" "$prefix/lib/lib$library-float64.a"
done
