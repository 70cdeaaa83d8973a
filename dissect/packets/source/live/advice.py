"""Advice for when capturing is not allowed or not possible: exact commands, for this machine and this user."""

from __future__ import annotations

import getpass
import os
import shutil
import sys
from pathlib import Path
from typing import Final

from dissect.wire.text import shortened

#: The group whose members may run dumpcap on Linux distributions.
_GROUP: Final = "wireshark"
_MORE: Final = "more: s7dissect help live"
_AS_ROOT: Final = (
    "root here has no CAP_NET_RAW, as in a container; start it with --cap-add=NET_RAW --cap-add=NET_ADMIN",
    _MORE,
)


def dumpcap_missing() -> tuple[str, ...]:
    """Return how to get dumpcap."""
    if sys.platform == "win32":
        return ("install Wireshark with Npcap, which its installer offers",)
    if sys.platform == "darwin":
        return ("install Wireshark with ChmodBPF, which comes with it",)
    return (
        "install it: sudo apt install wireshark-common (Debian, Ubuntu), sudo dnf install wireshark-cli (Fedora, RHEL)",
        "or read the interface without it: --engine ring, as root or with CAP_NET_RAW",
    )


def dumpcap_permission(program: str) -> tuple[str, ...]:
    """Return how to allow this user to capture with the dumpcap at ``program``."""
    if sys.platform == "win32":
        return ("start the console as administrator, or install Npcap without restricting it to administrators",)
    if sys.platform == "darwin":
        return ("install ChmodBPF, which comes with Wireshark, and log in again",)
    if _is_root():
        return _AS_ROOT
    join = "sudo usermod -aG {group} {user}    (then log out and in again)"
    gate = _gate_group(program)
    if gate and not _is_member(gate):
        return (join.format(group=gate, user=_user()), _MORE)
    grant = f"sudo setcap cap_net_raw,cap_net_admin=eip {program}"
    if Path("/etc/debian_version").exists() and not gate:
        asked = "sudo dpkg-reconfigure wireshark-common    (answer Yes)"
        return (asked, join.format(group=_GROUP, user=_user()), f"or, for every user of this machine: {grant}", _MORE)
    return (grant, _MORE)


def ring_permission() -> tuple[str, ...]:
    """Return how to allow this user to open the ring."""
    if _is_root():
        return _AS_ROOT
    user = _user()
    return (
        f'for one run: sudo "$(command -v s7dissect)" monitor …    (it becomes {user} again before it reads a packet)',
        "or with CAP_NET_RAW and no other right, which any program can be run with:",
        f'sudo setpriv --reuid {user} --regid "$(id -g)" --init-groups --inh-caps +net_raw --ambient-caps +net_raw s7dissect …',
        "for a service: AmbientCapabilities=CAP_NET_RAW in its systemd unit",
        "or let dumpcap capture, which needs no rights here: --engine dumpcap",
    )


def unknown_interface(names: list[str]) -> tuple[str, ...]:
    """Return which interfaces there are."""
    return (f"there are: {', '.join(names)}" if names else "there are none", "s7dissect interfaces describes them")


def interface_down(name: str) -> tuple[str, ...]:
    """Return how to switch an interface on."""
    return (f"sudo ip link set {name} up",)


def shown(expression: str) -> str:
    """Return a capture filter in quotes and shortened, for a message."""
    return f"'{shortened(expression, 80)}'"


def find_unusable(program: str) -> str:
    """Return the path of a program that exists, even if this user may not run it; empty when there is none."""
    return shutil.which(program, mode=os.F_OK) or ""


def _gate_group(program: str) -> str:
    """Return the group whose members may run ``program``, where other users may not; empty when there is no such group."""
    if sys.platform == "win32":
        return ""
    try:
        status = Path(program).stat()
        import grp

        name = grp.getgrgid(status.st_gid).gr_name
    except (ImportError, KeyError, OSError):
        return ""
    return name if status.st_mode & 0o011 == 0o010 and status.st_gid else ""


def _is_member(group: str) -> bool:
    if sys.platform == "win32":
        return False
    try:
        import grp

        wanted = grp.getgrnam(group).gr_gid
    except (ImportError, KeyError):
        return False
    return wanted == os.getegid() or wanted in os.getgroups()


def _is_root() -> bool:
    return hasattr(os, "geteuid") and os.geteuid() == 0


def _user() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # no name for this number
        return str(os.getuid()) if hasattr(os, "getuid") else "USER"
