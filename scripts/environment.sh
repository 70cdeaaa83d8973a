#!/usr/bin/env bash
# Make the virtual environment and install the package into it the way a user gets it: as a wheel, compiled where that is
# possible. With the argument "test", what the tests need comes with it. Nothing is done twice for the same sources.
#
# VENV names the folder (.venv), PYTHON the interpreter to make it with (the first of python3, python3.13 … that will do).
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

venv=${VENV:-.venv}
extra=${1:-}
wheels=$venv/s7dissect-wheel

find_python() {
  local candidate
  for candidate in ${PYTHON:-python3 python3.14 python3.13 python3.12 python3.11}; do
    if "$candidate" -c 'import sys, venv; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
      echo "$candidate"
      return
    fi
  done
  echo "environment: no Python 3.11 or newer with its venv module was found (tried ${PYTHON:-python3, python3.11 and newer})" >&2
  exit 1
}

# Whatever changes what is installed: the sources, how they are built, and for which interpreter.
fingerprint() {
  "$venv/bin/python" - <<'PROGRAM'
import hashlib, os, pathlib, sys

switches = [os.environ.get(name) for name in ("CC", "CFLAGS", "S7DISSECT_COMPILED", "S7DISSECT_RELEASE")]
seen = hashlib.sha256(repr((sys.version, switches)).encode())
files = [path for path in pathlib.Path("dissect").rglob("*") if path.is_file() and path.suffix != ".pyc"]
files += pathlib.Path("docs").glob("*.md")  # packed as the pages of `s7dissect help`
single = ("setup.py", "scripts/man_pages.py", "scripts/shim.c", "scripts/train.py")
single += ("pyproject.toml", "MANIFEST.in", "README.md", "LICENSE")
for path in [*sorted(files), *map(pathlib.Path, single)]:
    seen.update(repr((str(path), path.read_bytes())).encode())
print(seen.hexdigest())
PROGRAM
}

pip=("$venv/bin/python" -m pip)
if ! "$venv/bin/python" -c 'import pip' 2>/dev/null; then
  python=$(find_python)
  echo "environment: making $venv with $("$python" --version)"
  rm -rf "$venv"
  # To give it a pip of its own, and the bytecode of that, venv takes seconds in which nothing else can begin. Where the interpreter
  # has a pip that installs for others (22.3), that one does, and the environment gets its own with what the package needs.
  if "$python" -c 'import pip, sys; sys.exit([int(part) for part in pip.__version__.split(".")[:2]] < [22, 3])' 2>/dev/null; then
    "$python" -m venv --without-pip "$venv"
    pip=("$python" -m pip --python "$venv/bin/python")
  else
    "$python" -m venv "$venv"
  fi
fi
# Without bytecode: Python keeps that of a module when it is first imported, and to make it of all modules, most of which nobody
# imports, takes longer than to install them.
install=("${pip[@]}" --disable-pip-version-check --no-input -q install --no-compile)

# What the named table of pyproject.toml requires: "build", or the package with an extra (none: "").
requirements() {
  "$venv/bin/python" - "$1" <<'PROGRAM'
import re, sys, tomllib

with open("pyproject.toml", "rb") as file:
    said = tomllib.load(file)
project = said["project"]


def needed(extra):
    for line in project["optional-dependencies"][extra]:
        own = re.fullmatch(rf"{project['name']}\[(.*)\]", line)
        if own is None:
            yield line
        else:
            for other in own[1].split(","):
                yield from needed(other)


lines = said["build-system"]["requires"] if sys.argv[1] == "build" else project["dependencies"]
print("\n".join([*lines, *(needed(sys.argv[1]) if sys.argv[1] not in {"", "build"} else [])]))
PROGRAM
}

fetched=
print=$(fingerprint)
if [ "$(cat "$wheels/built" 2>/dev/null)" != "$print" ]; then
  echo "environment: building the package"
  # Never pack what an earlier build left behind.
  rm -rf build s7dissect.egg-info "$wheels"
  mkdir -p "$wheels"
  requirements build >"$wheels/build-requirements.txt"
  grep '^mypy' "$wheels/build-requirements.txt" >"$wheels/compiler.txt"
  grep -v '^mypy' "$wheels/build-requirements.txt" >"$wheels/others.txt"
  # The compiler is half of what the build needs, so that two processes fetch it in half the time.
  "${install[@]}" -r "$wheels/others.txt" </dev/null & others=$!
  "${install[@]}" -r "$wheels/compiler.txt" </dev/null
  wait $others
  # What the package needs comes meanwhile: a good part of the build keeps one processor busy. What fails here fails again below.
  (requirements "$extra" && echo pip) >"$wheels/requirements.txt"
  "${install[@]}" -r "$wheels/requirements.txt" </dev/null >"$wheels/requirements.log" 2>&1 &
  fetched=yes
  # What pip would call, in this environment: one of its own for the build would install the compiler a second time. Not compressed:
  # the wheel goes no further than this folder.
  if ! "$venv/bin/python" -c '
import os, sys
from setuptools import build_meta
build_meta.build_wheel(sys.argv[1], {"--build-option": "--compression=stored"})
sys.stdout.flush(), sys.stderr.flush()
os._exit(0)  # to take apart all that mypy made of the sources, object by object, takes seconds' "$wheels" \
    >"$wheels/build.log" 2>&1 </dev/null; then
    cat "$wheels/build.log" >&2
    exit 1
  fi
  # What mypyc objected to, and the line that tells of the fallback, matter.
  grep -E 's7dissect: the (engine (is NOT|cannot be) compiled|pages of man are NOT built)|^ *dissect/[^ ]*\.py:[0-9]+: error' "$wheels/build.log" | sed 's/^ *//' || true
  rm -rf build s7dissect.egg-info
  echo "$print" >"$wheels/built"
fi

wait
# An index may lack pip; what came with Python does then.
"$venv/bin/python" -c 'import pip' 2>/dev/null || "$venv/bin/python" -m ensurepip </dev/null
wheel=$(echo "$wheels"/*.whl)
if [ ! -e "$wheels/installed-$extra" ]; then
  echo "environment: installing it${extra:+ with what the ${extra}s need}"
  if [ -z "$fetched" ]; then
    # As a list, as beside the build: asked for as an extra of the wheel, pip may not find versions that go together.
    requirements "$extra" >"$wheels/requirements.txt"
    "${install[@]}" -r "$wheels/requirements.txt" </dev/null
  fi
  # The same version is not the same build: pip would leave an earlier one where it is.
  if [ -e "$venv/bin/s7dissect" ]; then
    "${install[@]}" --force-reinstall --no-deps "$wheel" </dev/null
  fi
  "${install[@]}" "$wheel${extra:+[$extra]}" </dev/null
  touch "$wheels/installed-" "$wheels/installed-$extra"
fi
"$venv/bin/s7dissect" --version
