#!/usr/bin/env bash
# The tests compare with tshark: install it from the distribution's packages when it is missing.
set -euo pipefail

command -v tshark >/dev/null && exit 0

fail() {
  echo "install-tshark: tshark is missing and $1; install Wireshark's tshark by hand and run this again" >&2
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

echo "install-tshark: installing tshark with apt-get"
apt_get=(env DEBIAN_FRONTEND=noninteractive apt-get -qq -o Acquire::Retries=3)
# Reading captures needs no privilege; without an answer wireshark-common would ask whether to give its users one.
echo "wireshark-common wireshark-common/install-setuid boolean false" | "${as_root[@]}" debconf-set-selections \
  || fail "installing it takes root or sudo"
"${as_root[@]}" "${apt_get[@]}" update </dev/null || fail "apt-get update failed"
"${as_root[@]}" "${apt_get[@]}" install --yes --no-install-recommends tshark </dev/null || fail "apt-get install failed"
tshark --version | head -n 1
