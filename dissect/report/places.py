"""Where a packet of a run stands: by its number in a single file, by file and number within it in several.

The pipeline counts packets over the whole run. A person looks for them in a file, and so may a program, so every face gives
the number within the file, and names the file as soon as more than one was given.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping, Sequence

from dissect.source.packet import SourceFile
from dissect.tcp.connection import Endpoint
from dissect.wire.text import encodable, printable


class Places:
    """Finds packets of a run in its files.

    ``files`` may still grow while it is asked. ``several`` says whether file names are told, whatever was read so far.
    ``hosts`` are names of hosts by their address.
    """

    def __init__(self, files: Sequence[SourceFile], several: bool, hosts: Mapping[str, str] | None = None) -> None:
        self._files = files
        self.several = several
        self._hosts: dict[str, str] = {address: printable(name) for address, name in (hosts or {}).items()}

    def end(self, end: Endpoint) -> str:
        """Return an end of a connection as text for a person has it: address and port, the name of the host for its address."""
        if self._hosts:
            name = self._hosts.get(end.host)
            if name is not None:
                return f"{name}:{end.port}"
        return str(end)

    def locate(self, frame: int) -> tuple[str, int]:
        """Return (file name, number within that file) of the packet that is number ``frame`` of the run."""
        index = bisect_right(self._files, frame, key=lambda file: int(file.first_frame)) - 1
        file = self._files[max(index, 0)]
        return encodable(file.name), frame - int(file.first_frame) + 1

    def number(self, frame: int) -> int:
        """Return the number of a packet within its file."""
        return self.locate(frame)[1] if self.several else frame

    def mark(self, frame: int) -> str:
        """Return a packet as a line begins with it: ``12``, or ``NAME:12`` in several files."""
        if not self.several:
            return str(frame)
        name, number = self.locate(frame)
        return f"{printable(name)}:{number}"

    def pair(self, request_frame: int, response_frame: int) -> str:
        """Return the packets of a request and its answer, 0 for none: ``8→9``, ``8→?``, ``NAME:8→9``, ``ONE:8→OTHER:1``."""
        asked = self.mark(request_frame) if request_frame else "?"
        if not response_frame:
            return f"{asked}→?"
        if not request_frame:
            answered = self.mark(response_frame)
            name, colon, number = answered.rpartition(":")
            return f"{name}{colon}?→{number}"
        same = not self.several or self.locate(request_frame)[0] == self.locate(response_frame)[0]
        return f"{asked}→{self.number(response_frame) if same else self.mark(response_frame)}"

    def phrase(self, frames: Sequence[int]) -> str:
        """Return packets in words: ``packet 8``, ``packets 8, 9``, ``packets 8, 9 of NAME``; ``the capture`` for none."""
        if not frames:
            return "the capture"
        if not self.several:
            return _numbered(frames)
        by_file: dict[str, list[int]] = {}
        for frame in frames:
            name, number = self.locate(frame)
            by_file.setdefault(name, []).append(number)
        return ", ".join([f"{_numbered(numbers)} of {printable(name)}" for name, numbers in by_file.items()])


def _numbered(numbers: Sequence[int]) -> str:
    return f"packet{'s' if len(numbers) > 1 else ''} {', '.join([str(number) for number in numbers])}"
