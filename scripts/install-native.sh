#!/usr/bin/env bash
# The fake PLC is tested with the Snap7 library as well: python-snap7 2, which brings it and has the name of python-snap7 3. So it gets a
# folder of its own, VENV/snap7-native. Nothing is done twice.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

venv=${VENV:-.venv}
home=$venv/snap7-native
wanted=captures/record/requirements-native.txt
if cmp -s "$wanted" "$home/installed"; then
  exit 0
fi
rm -rf "$home"
pip=("$venv/bin/python" -m pip --disable-pip-version-check --no-input -q)
# Its wheels are of few machines; where there is none, the tests say so.
if ! "${pip[@]}" install --no-compile --no-deps --only-binary :all: --target "$home" -r "$wanted" </dev/null; then
  echo "install-native: there is no wheel of $(cat "$wanted") for this machine, so it is left out" >&2
  rm -rf "$home"
  [ -z "${CI:-}" ] || exit 1
  exit 0
fi
cp "$wanted" "$home/installed"
