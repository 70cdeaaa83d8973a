#!/usr/bin/env bash
# The tests fetch captures from real servers: install OpenSSH's and nginx from the distribution's packages when they are missing.
# None of them is started as a service by that; a test starts its own on loopback and ends it.
set -euo pipefail

export PATH=$PATH:/usr/sbin

fail() {
  echo "install-servers: sshd or nginx is missing and $1; install openssh-server and nginx by hand and run this again" >&2
  exit 1
}

as_root=()
if [ "$(id -u)" -ne 0 ]; then
  # Nobody is there to type a password when the input is no terminal.
  if [ -t 0 ]; then as_root=(sudo); else as_root=(sudo -n); fi
fi

if ! { command -v sshd && command -v nginx; } >/dev/null; then
  command -v apt-get >/dev/null || fail "this system has no apt-get"
  [ ${#as_root[@]} -eq 0 ] || command -v sudo >/dev/null || fail "installing them takes root or sudo"
  echo "install-servers: installing openssh-server and nginx with apt-get"
  policy=/usr/sbin/policy-rc.d
  if [ ! -e "$policy" ]; then
    trap '"${as_root[@]}" rm -f "$policy"' EXIT
    printf '#!/bin/sh\nexit 101\n' | "${as_root[@]}" tee "$policy" >/dev/null || fail "installing them takes root or sudo"
    "${as_root[@]}" chmod 755 "$policy"
  fi
  apt_get=(env DEBIAN_FRONTEND=noninteractive apt-get -qq -o Acquire::Retries=3)
  "${as_root[@]}" "${apt_get[@]}" update </dev/null || fail "apt-get update failed"
  "${as_root[@]}" "${apt_get[@]}" install --yes --no-install-recommends openssh-server nginx-light </dev/null \
    || fail "apt-get install failed"
fi

# Where root runs sshd, it wants this folder, which the service would make.
[ "$(id -u)" -ne 0 ] || install -d -m 0755 /run/sshd
