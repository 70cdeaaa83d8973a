"""Drops privileges once the packet socket is open and before the first packet is examined, as tcpdump's -Z does.

This is for a process that only reads an interface afterwards, so the command line decides about it; `open_live` never does it.
It changes the whole process. Capabilities belong to each thread, so a user other than root who has some must not have started
another thread yet. Sources: credentials(7), capabilities(7), setresuid(2), prctl(2).
"""

from __future__ import annotations

import ctypes
import os
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

from dissect.packets.source.live.reader import LiveError
from dissect.wire.text import printable

_SET_NO_NEW_PRIVS: Final = 38
_CAPABILITY_VERSION: Final = 0x20080522
#: The user id of ``nobody`` if the system has no such name.
_NOBODY: Final = 65534
_NUMBER: Final = re.compile(r"[0-9]{1,10}")
_RIGHTS: Final = re.compile(rb"^Cap(?:Inh|Prm|Eff|Amb):\s*0*([0-9a-f]*)$", re.MULTILINE)
_USERS: Final = re.compile(rb"^Uid:\s*(.*)$", re.MULTILINE)
_CHOOSE: Final = "-Z USER names a different user, -Z root keeps all privileges"


class User(NamedTuple):
    """The user that a process becomes. ``name`` is empty for a user id without a name."""

    name: str
    uid: int
    gid: int

    def __str__(self) -> str:
        return f"{self.name} ({self.uid})" if self.name else f"user {self.uid}"


def is_root() -> bool:
    """Return whether this process runs as root."""
    return hasattr(os, "geteuid") and os.geteuid() == 0


def heir(name: str = "") -> User:
    """Return the user that root becomes: ``name``, the user who called sudo, or ``nobody``. `LiveError` for a wrong name."""
    if sys.platform == "win32":
        raise LiveError("Windows has no user to become (-Z)")
    import pwd

    if name:
        try:
            found = pwd.getpwuid(int(name)) if _NUMBER.fullmatch(name) else pwd.getpwnam(name)
        except (KeyError, OverflowError):
            raise LiveError(f"there is no user {printable(name)!r} to become (-Z)") from None
        return User(found.pw_name, found.pw_uid, found.pw_gid)
    caller, group = os.environ.get("SUDO_UID", ""), os.environ.get("SUDO_GID", "")
    if _NUMBER.fullmatch(caller) and int(caller):
        uid = int(caller)
        try:
            entry = pwd.getpwuid(uid)
        except (KeyError, OverflowError):
            return User("", uid, int(group) if _NUMBER.fullmatch(group) and int(group) else uid)
        return User(entry.pw_name, uid, int(group) if _NUMBER.fullmatch(group) and int(group) else entry.pw_gid)
    try:
        entry = pwd.getpwnam("nobody")
    except KeyError:
        return User("", _NOBODY, _NOBODY)
    return User(entry.pw_name, entry.pw_uid, entry.pw_gid)


def missing(directory: str) -> list[Path]:
    """Return those of ``directory`` and its parents that do not exist yet, the outermost first."""
    path = Path(directory).absolute()
    return [one for one in (*reversed(path.parents), path) if not os.path.lexists(one)]


def give(made: Sequence[Path], user: User) -> None:
    """Make ``user`` the owner of folders and files that this process has made."""
    if sys.platform == "win32":
        return
    for path in made:
        handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
        try:
            os.fchown(handle, user.uid, user.gid)
        finally:
            os.close(handle)


def _drop_capabilities() -> None:
    """Drop all capabilities, and keep programs that are started later from gaining any. Raises OSError."""
    library = ctypes.CDLL(None, use_errno=True)
    header = (ctypes.c_uint32 * 2)(_CAPABILITY_VERSION, 0)
    if library.capset(header, (ctypes.c_uint32 * 6)()) or library.prctl(_SET_NO_NEW_PRIVS, 1, 0, 0, 0):
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))


def relinquish(user: User | None) -> None:
    """Become ``user`` (None: stay the same user) without any capability and without a way back; `LiveError` when that fails.

    Programs started later gain no privileges either (no_new_privs). A caller that catches the error must end the process.
    """
    if sys.platform != "linux":  # as the ring is, which this is for
        raise LiveError("privileges can be dropped only on Linux")
    try:
        if user is not None:
            if user.name:
                os.initgroups(user.name, user.gid)
            else:
                os.setgroups([user.gid])
            os.setresgid(user.gid, user.gid, user.gid)
            os.setresuid(user.uid, user.uid, user.uid)
        _drop_capabilities()
    except OSError as error:
        who = f"become {user}" if user is not None else "give up its rights"
        raise LiveError(
            f"this program could not {who}: {error.strerror}", (_CHOOSE,) if user is not None else ()
        ) from None
    left = rights_left()
    if left:
        raise LiveError(f"privileges should have been dropped but remain: {left}")


def rights_left() -> str:
    """Return which privileges a thread of this process still has, according to the kernel; empty when none has any."""
    if sys.platform != "linux":
        return ""
    if 0 in os.getresuid():
        return "those of root"
    for status in sorted(Path("/proc/self/task").glob("*/status")):
        try:
            text = status.read_bytes()  # not text: its codec may not be loadable now, where only root may read Python
        except OSError:
            continue  # a thread that has just ended
        if any([number == b"0" for line in _USERS.findall(text) for number in line.split()]):
            return "those of root, in a thread"
        if any(_RIGHTS.findall(text)):
            return "capabilities, in a thread"
    return ""


def program_readable() -> bool:
    """Return whether this process may still read the files of Python; if not, no further modules can be imported."""
    return all([os.access(file, os.R_OK) for file in (os.__file__, __file__)])


def unreadable(user: User | None) -> LiveError:
    """Return the error for screens, which import modules while they run, when `program_readable` is False."""
    who = str(user) if user is not None else "this user"
    return LiveError(
        f"the screens need the files of Python in {Path(os.__file__).parent}, which {who} may not read",
        ("--plain shows one line per event without them", f"or {_CHOOSE}"),
    )


def check_writable(directory: str, user: User | None) -> None:
    """Raise `LiveError` unless this process, which runs as ``user`` by now, may create files in ``directory``."""
    if os.access(directory, os.W_OK | os.X_OK):
        return
    if user is None:
        raise LiveError(f"{printable(directory)}: this user may not write there")
    owner = user.name or str(user.uid)
    raise LiveError(
        f"{printable(directory)}: {user}, who this program becomes before it reads packets, may not write there",
        (f"take a folder that {owner} may write to, for example after: chown {owner} DIR", f"or {_CHOOSE}"),
    )
