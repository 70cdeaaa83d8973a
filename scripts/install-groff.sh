#!/usr/bin/env bash
# The tests render the manual pages as `man` does: install groff from the distribution's packages when it is missing.
set -euo pipefail

command -v groff >/dev/null && exit 0

fail() {
  echo "install-groff: groff is missing and $1; install it by hand and run this again" >&2
  exit 1
}

command -v apt-get >/dev/null || fail "this system has no apt-get"
as_root=()
if [ "$(id -u)" -ne 0 ]; then
  command -v sudo >/dev/null || fail "installing it takes root or sudo"
  as_root=(sudo)
  # Nobody is there to type a password when the input is no terminal.
  [ -t 0 ] || as_root=(sudo -n)
fi

echo "install-groff: installing groff-base with apt-get"
apt_get=(env DEBIAN_FRONTEND=noninteractive apt-get -qq -o Acquire::Retries=3)
"${as_root[@]}" "${apt_get[@]}" update </dev/null || fail "apt-get update failed"
"${as_root[@]}" "${apt_get[@]}" install --yes --no-install-recommends groff-base </dev/null \
  || fail "apt-get install failed"
groff --version | head -n 1
