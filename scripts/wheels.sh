#!/usr/bin/env bash
# Build what a release consists of, as far as this machine can, into dist/, and try each file in a fresh environment:
# the source distribution, the compiled wheel of this interpreter made from it, and the pure wheel for all others (docs/release.md).
#
# PYTHON names the interpreter (python3). S7DISSECT_RELEASE=0 builds the compiled wheel fast, to try the recipe.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

export S7DISSECT_RELEASE=${S7DISSECT_RELEASE:-1}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

echo "wheels: making an environment to build in"
"${PYTHON:-python3}" -m venv "$work/build"
python=$work/build/bin/python
"$python" -m pip --disable-pip-version-check -q install build

rm -rf dist
echo "wheels: the source distribution"
"$python" -m build --sdist --outdir dist . >"$work/log" 2>&1 || { cat "$work/log" >&2; exit 1; }
sdist=$(echo dist/*.tar.gz)
mkdir "$work/source" "$work/again"
tar -xzf "$sdist" -C "$work/source" --strip-components=1

same() { # A FILE OF dist: a second build of it, made from the source distribution elsewhere, has to have the same bytes
  cmp "$1" "$work/again/$(basename "$1")"
  echo "wheels: the same again, $(sha256sum "$1")"
}

wheel() { # COMPILED, as S7DISSECT_COMPILED, and the folder
  S7DISSECT_COMPILED=$1 "$python" -m build --wheel --outdir "$2" "$work/source" >"$work/log" 2>&1 ||
    { cat "$work/log" >&2; exit 1; }
  rm -rf "$work/source/build" "$work/source/s7dissect.egg-info"
}

# With another umask and other times, as in the checkout of somebody else.
cp -r "$work/source" "$work/copy"
chmod -R go-rwx "$work/copy"
(umask 077 && "$python" -m build --sdist --outdir "$work/again" "$work/copy" >"$work/log" 2>&1) ||
  { cat "$work/log" >&2; exit 1; }
same "$sdist"

try() { # NAME OF THE BUILD, WHEEL
  echo "wheels: trying $2"
  "$python" -m venv "$work/$1"
  "$work/$1/bin/python" -m pip --disable-pip-version-check -q install "$2" "pytest>=8.4" "hypothesis>=6.100"
  # From the source distribution: what it lacks cannot be tested from it.
  "$work/$1/bin/python" "$work/source/scripts/try_install.py" "$1"
}

echo "wheels: the pure wheel"
wheel 0 dist
wheel 0 "$work/again"
same dist/*-py3-none-any.whl
try interpreted dist/*-py3-none-any.whl

echo "wheels: the compiled wheel (-O3, takes minutes; one that cannot be compiled is an error)"
wheel 1 dist
try compiled dist/*-cp3*.whl

ls -l dist
