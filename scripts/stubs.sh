#!/usr/bin/env bash
# Writes the type stubs of the native module from the installed package; `check` compares only.
set -euo pipefail
cd "$(dirname "$0")/.."
bin=$(realpath "${VSR2_VENV:-.venv}")/bin
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT
(cd "$out" && "$bin/python" -m pybind11_stubgen vsr2._native --output-dir . --numpy-array-wrap-with-annotated \
  --print-value-comments >/dev/null)
# A choice of words is a type; other values are not needed.
sed -E -i 's/^(\w+): typing\._LiteralGenericAlias  # value = (.*)$/\1 = \2/; s/  # value = .*//' "$out/vsr2/_native.pyi"
# Of an enumeration of words its members; the machinery that it inherits differs between interpreters.
awk '/^[^ ]/ { words = /enum[.]StrEnum/ } !words || /^class/ || /^    [a-z][a-z_]*: typing[.]ClassVar[[][A-Z]/' \
  "$out/vsr2/_native.pyi" | grep -v '^import builtins$' >"$out/stub.pyi"
if [ "${1:-}" = check ]; then
  diff -u python/vsr2/_native.pyi "$out/stub.pyi"
else
  cp "$out/stub.pyi" python/vsr2/_native.pyi
fi
