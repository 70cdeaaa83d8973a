#!/usr/bin/env bash
# The tests open the HTML report in a real browser: install Chromium and its driver from the distribution's packages when they
# are missing.
set -euo pipefail

command -v chromium >/dev/null && command -v chromedriver >/dev/null && exit 0

fail() {
  echo "install-browser: chromium or chromedriver is missing and $1; install both by hand and run this again" >&2
  exit 1
}

command -v apt-get >/dev/null || fail "this system has no apt-get"
as_root=()
if [ "$(id -u)" -ne 0 ]; then
  command -v sudo >/dev/null || fail "installing them takes root or sudo"
  as_root=(sudo)
  # Nobody is there to type a password when the input is no terminal.
  [ -t 0 ] || as_root=(sudo -n)
fi

echo "install-browser: installing chromium and chromium-driver with apt-get"
apt_get=(env DEBIAN_FRONTEND=noninteractive apt-get -qq -o Acquire::Retries=3)
"${as_root[@]}" "${apt_get[@]}" update </dev/null || fail "apt-get update failed"
"${as_root[@]}" "${apt_get[@]}" install --yes --no-install-recommends chromium chromium-driver </dev/null \
  || fail "apt-get install failed"
chromium --version
