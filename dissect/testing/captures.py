"""`s7_capture`: the captures in a project's folder, and their contents."""

from __future__ import annotations

import difflib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Final

import dissect
from dissect.packets.source.packet import CaptureError

if TYPE_CHECKING:
    from dissect.files.session import Event
    from dissect.testing.golden.model import Session

#: Mistakes of the author of a test, in the call or on disk: reported at the line of the test, without a traceback into the
#: package.
MISTAKES: Final = (CaptureError, OSError, ValueError)

#: Suffixes that a name may leave out.
SUFFIXES: Final = (
    ".pcapng",
    ".pcap",
    *(f"{form}{packing}" for packing in (".gz", ".zst") for form in (".pcapng", ".pcap")),
    ".s7.txt",
)
_LIKE: Final = 5


class Capture:
    """A capture: its path and its contents. Every access reads the file again, because it may have changed."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def analysis(self, slow_ns: int = 1_000_000_000) -> dissect.Analysis:
        """Return the result of `dissect.analyze`."""
        return dissect.analyze(str(self.path), slow_ns=slow_ns)

    def events(self) -> Iterator[Event]:
        """Yield the results of `dissect.open` without single PDUs: connections, transactions, operations, findings."""
        return dissect.open(str(self.path), pdus=False)

    def transactions(self) -> list[dissect.Transaction]:
        """Return all transactions."""
        return [event for event in self.events() if isinstance(event, dissect.Transaction)]

    def findings(self) -> list[dissect.Finding]:
        """Return the findings that no other finding explains."""
        return [event for event in self.events() if isinstance(event, dissect.Finding) and not event.because]

    def session(self) -> Session:
        """Return the capture as a session, which can be compared with a golden."""
        from dissect.testing.golden.reading import read_session

        return read_session(self.path)

    def __fspath__(self) -> str:
        return str(self.path)

    def __repr__(self) -> str:
        return f"Capture({str(self.path)!r})"


class CaptureFolder:
    """Opens captures by name: ``s7_capture("pump")``."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __call__(self, name: str | os.PathLike[str]) -> Capture:
        """Return a capture: a file of the folder, with or without its suffix, or any file by its path.

        Raises FileNotFoundError, which lists the files that exist.
        """
        __tracebackhide__ = True
        path = self.folder / name
        for one in (path, *[path.with_name(path.name + suffix) for suffix in SUFFIXES], Path(name)):
            if one.is_file():
                return Capture(one)
        raise FileNotFoundError(self._missing_text(path))

    def _missing_text(self, path: Path) -> str:
        if not self.folder.is_dir():
            return f"no capture {near(path)}: there is no folder {near(self.folder)} (the ini setting s7_captures names it)"
        there = sorted([one.relative_to(self.folder).as_posix() for one in self.folder.rglob("*") if one.is_file()])
        like = difflib.get_close_matches(path.name, there, _LIKE, 0.4) or there[:_LIKE]
        return f"no capture {near(path)}; in {near(self.folder)} there is {', '.join(like) or 'nothing'}"


def path_of(what: object, captures: CaptureFolder) -> Path:
    """Return the path of a capture or recorder, or of a capture's name or path. Raises TypeError for anything else."""
    __tracebackhide__ = True
    if isinstance(what, Capture):
        return what.path
    capture = getattr(what, "capture", None)
    if callable(capture):
        return Path(capture())
    if isinstance(what, (str, os.PathLike)):
        return captures(what).path
    raise TypeError(f"{what!r} is not a capture, a session or a path")


def near(path: str | os.PathLike[str]) -> str:
    """Return a path relative to the current folder if it is below it."""
    relative = os.path.relpath(path)
    return os.fspath(path) if relative.startswith(os.pardir) else relative
