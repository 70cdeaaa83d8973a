#!/usr/bin/env bash
# What the tests ask and compare with: whatever of it is missing is installed from the distribution's packages, all at once.
#
#   tshark                         reads the same captures
#   chromium, chromedriver         open the HTML report
#   firefox-esr                    opens the analyzer in one file
#   groff                          renders the manual pages as man does
#   valgrind                       counts the instructions of the engine
#   sshd, nginx                    serve captures; none is started as a service, a test starts its own on loopback and ends it
#   systemd-analyze, libseccomp, setcap, ip   run the probe under its system call filter; only root runs these tests
set -euo pipefail

export PATH=$PATH:/usr/sbin:/sbin

missing=()
needs() { # PROGRAM PACKAGE...
  command -v "$1" >/dev/null || missing+=("${@:2}")
}
needs tshark tshark
needs chromium chromium
needs chromedriver chromium-driver
needs firefox-esr firefox-esr
needs groff groff-base
needs valgrind valgrind
needs sshd openssh-server
needs nginx nginx-light
if [ "$(id -u)" -eq 0 ]; then
  needs systemd-analyze systemd
  needs setcap libcap2-bin
  needs ip iproute2
  grep -q libseccomp.so.2 <(ldconfig -p 2>/dev/null) || missing+=(libseccomp2)
fi

as_root=()
if [ "$(id -u)" -ne 0 ]; then
  # Nobody is there to type a password when the input is no terminal.
  if [ -t 0 ]; then as_root=(sudo); else as_root=(sudo -n); fi
fi

install_missing() {
  fail() {
    echo "install-tools: missing: ${missing[*]}, and $1; install them by hand and run this again" >&2
    exit 1
  }
  command -v apt-get >/dev/null || fail "this system has no apt-get"
  [ ${#as_root[@]} -eq 0 ] || command -v sudo >/dev/null || fail "installing takes root or sudo"
  echo "install-tools: installing ${missing[*]} with apt-get"
  # Reading captures needs no privilege; without an answer wireshark-common would ask whether to give its users one.
  echo "wireshark-common wireshark-common/install-setuid boolean false" | "${as_root[@]}" debconf-set-selections \
    || fail "installing takes root or sudo"
  # The servers are wanted as programs: with this answer no package starts a service.
  policy=/usr/sbin/policy-rc.d
  if [ ! -e "$policy" ]; then
    trap '"${as_root[@]}" rm -f "$policy"' EXIT
    printf '#!/bin/sh\nexit 101\n' | "${as_root[@]}" tee "$policy" >/dev/null
    "${as_root[@]}" chmod 755 "$policy"
  fi
  apt_get=(env DEBIAN_FRONTEND=noninteractive apt-get -qq -o Acquire::Retries=3)
  "${as_root[@]}" "${apt_get[@]}" update </dev/null || fail "apt-get update failed"
  "${as_root[@]}" "${apt_get[@]}" install --yes --no-install-recommends "${missing[@]}" </dev/null \
    || fail "apt-get install failed"
  tshark --version 2>/dev/null | head -n 1
}

[ ${#missing[@]} -eq 0 ] || install_missing

# Where root runs sshd, it wants this folder, which the service would make.
[ "$(id -u)" -ne 0 ] || install -d -m 0755 /run/sshd
