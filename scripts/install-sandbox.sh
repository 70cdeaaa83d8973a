#!/usr/bin/env bash
# The tests run the probe under the system call filter of its unit, in a network of their own: install what that takes (the groups
# as systemd lists them, libseccomp, setcap, ip) from the distribution's packages when it is missing.
set -euo pipefail

missing=()
command -v systemd-analyze >/dev/null || missing+=(systemd)
ldconfig -p 2>/dev/null | grep -q libseccomp.so.2 || missing+=(libseccomp2)
command -v setcap >/dev/null || missing+=(libcap2-bin)
command -v ip >/dev/null || missing+=(iproute2)
[ "${#missing[@]}" -eq 0 ] && exit 0

# Only root can run these tests; nobody else needs what they need, and they say so when they are skipped.
if [ "$(id -u)" -ne 0 ] || ! command -v apt-get >/dev/null; then
  echo "install-sandbox: ${missing[*]} missing; the tests of the systemd unit will be skipped" >&2
  exit 0
fi
echo "install-sandbox: installing ${missing[*]} with apt-get"
apt_get=(env DEBIAN_FRONTEND=noninteractive apt-get -qq -o Acquire::Retries=3)
"${apt_get[@]}" update </dev/null && "${apt_get[@]}" install --yes --no-install-recommends "${missing[@]}" </dev/null || {
  echo "install-sandbox: apt-get failed" >&2
  exit 1
}
