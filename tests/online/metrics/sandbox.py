"""Runs a command as the unit would: its user without rights, its capability, its system calls, by libseccomp. Not a test.

Called as a program with a JSON object (``calls``, ``errno``, ``families``, ``no_new_code``, ``uid``) and the command. Their
meaning for systemd is in systemd.exec(5); the calls of its groups are those listed by `systemd-analyze syscall-filter`.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import errno
import json
import os
import re
import subprocess
import sys
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

_CLONE_NEWNS: Final = 0x00020000
_ALLOW: Final = 0x7FFF0000
_ERRNO: Final = 0x00050000
_EQUAL: Final = 4
_MASKED_EQUAL: Final = 7
_CAP_NET_RAW: Final = 13
_LAST_CAP: Final = 40
_PR_CAPBSET_DROP: Final = 24
_PR_SET_KEEPCAPS: Final = 8
_PR_SET_NO_NEW_PRIVS: Final = 38
_PR_CAP_AMBIENT: Final = 47
_WRITE: Final = 2
_EXECUTE: Final = 4
FAMILIES: Final = {"AF_UNIX": 1, "AF_INET": 2, "AF_INET6": 10, "AF_NETLINK": 16, "AF_PACKET": 17}


class _Condition(ctypes.Structure):
    _fields_ = [("argument", ctypes.c_uint), ("operator", ctypes.c_int), ("a", ctypes.c_uint64), ("b", ctypes.c_uint64)]


def library() -> str | None:
    """Return libseccomp, None if it is not installed."""
    return ctypes.util.find_library("seccomp")


def group(name: str) -> set[str]:
    """Return the system calls of a group of systemd, those of the groups in it included."""
    listed = subprocess.run(
        ["systemd-analyze", "syscall-filter", name], capture_output=True, text=True, check=True
    ).stdout
    found: set[str] = set()
    for line in listed.splitlines()[1:]:
        word = line.strip()
        if word.startswith("@"):
            found |= group(word)
        elif re.fullmatch(r"[a-z0-9_]+", word):
            found.add(word)
    return found


def allowed(lines: list[str]) -> set[str]:
    """Return the system calls that the lines ``SystemCallFilter=`` of a unit allow; the first line lists allowed ones."""
    calls = group("@default")  # always allowed
    for line in lines:
        named: set[str] = set()
        for word in line.removeprefix("~").split():
            named |= group(word) if word.startswith("@") else {word}
        calls = calls - named if line.startswith("~") else calls | named
    return calls


def _filter(default: int, rules: list[tuple[int, str, list[tuple[int, int, int, int]]]]) -> None:
    """Load a filter: calls that no rule matches get the default."""
    seccomp = ctypes.CDLL(library())
    seccomp.seccomp_init.restype = ctypes.c_void_p
    context = ctypes.c_void_p(seccomp.seccomp_init(ctypes.c_uint32(default)))
    for action, call, conditions in rules:
        number = seccomp.seccomp_syscall_resolve_name(call.encode())
        if number < 0:
            continue  # not a call of this machine
        array = (_Condition * len(conditions))(*[_Condition(*one) for one in conditions])
        code = seccomp.seccomp_rule_add_array(context, ctypes.c_uint32(action), number, len(conditions), array)
        if code:
            raise OSError(-code, f"{call}: {os.strerror(-code)}")
    code = seccomp.seccomp_load(context)
    if code:
        raise OSError(-code, os.strerror(-code))
    seccomp.seccomp_release(context)


def _open_the_way() -> None:
    """Let the unit's user reach this interpreter if it is in a closed folder: in a separate mount namespace."""
    base = Path(sys.base_prefix).resolve()
    closed = next((one for one in reversed(base.parents) if not one.stat().st_mode & 0o001), None)
    if closed is None:
        return
    if ctypes.CDLL(None, use_errno=True).unshare(_CLONE_NEWNS):
        raise OSError(ctypes.get_errno(), "no mount namespace")
    with tempfile.TemporaryDirectory() as beside:
        for command in (
            ["mount", "--make-rprivate", "/"],
            ["mount", "--bind", str(base), beside],
            ["mount", "-t", "tmpfs", "-o", "mode=755", "tmpfs", str(closed)],
            ["mkdir", "-p", str(base)],
            ["mount", "--bind", beside, str(base)],
            ["umount", beside],
        ):
            subprocess.run(command, check=True)


def _enter(wanted: dict[str, Any]) -> None:
    _open_the_way()
    libc = ctypes.CDLL(None, use_errno=True)

    def prctl(*numbers: int) -> None:
        if libc.prctl(*[ctypes.c_ulong(number) for number in (*numbers, 0, 0, 0, 0)][:5]):
            raise OSError(ctypes.get_errno(), f"prctl {numbers}")

    for capability in range(_LAST_CAP + 1):
        if capability != _CAP_NET_RAW:
            with suppress(OSError):  # a kernel with fewer
                prctl(_PR_CAPBSET_DROP, capability)
    prctl(_PR_SET_KEEPCAPS, 1)
    os.setgroups([])
    os.setresgid(*[wanted["uid"]] * 3)
    os.setresuid(*[wanted["uid"]] * 3)
    header = (ctypes.c_uint32 * 2)(0x20080522, 0)
    bit = 1 << _CAP_NET_RAW
    if libc.capset(header, (ctypes.c_uint32 * 6)(bit, bit, bit, 0, 0, 0)):
        raise OSError(ctypes.get_errno(), "capset")
    prctl(_PR_CAP_AMBIENT, 2, _CAP_NET_RAW)
    prctl(_PR_SET_NO_NEW_PRIVS, 1)
    families = [FAMILIES[name] for name in wanted["families"]]
    others = [family for family in range(46) if family not in families]
    refuse = _ERRNO | errno.EAFNOSUPPORT
    _filter(_ALLOW, [(refuse, "socket", [(0, _EQUAL, family, 0)]) for family in others])
    if wanted["no_new_code"]:
        both = _WRITE | _EXECUTE
        rules = [(_ERRNO | errno.EPERM, "mmap", [(2, _MASKED_EQUAL, both, both)])]
        rules += [
            (_ERRNO | errno.EPERM, call, [(2, _MASKED_EQUAL, _EXECUTE, _EXECUTE)])
            for call in ("mprotect", "pkey_mprotect")
        ]
        _filter(_ALLOW, rules)
    _filter(_ERRNO | getattr(errno, wanted["errno"]), [(_ALLOW, call, []) for call in wanted["calls"]])


if __name__ == "__main__":
    _enter(json.loads(sys.argv[1]))
    os.execv(sys.argv[2], sys.argv[2:])
