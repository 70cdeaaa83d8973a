"""`s7_server`: fake PLCs for a test, and the requests they received that were not recorded."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

from dissect.testing.captures import MISTAKES, CaptureFolder, near, path_of
from dissect.testing.playback.server.service import Server
from dissect.wire.text import printable

if TYPE_CHECKING:
    from dissect.testing.playback.server.faults import Fault

FAIL: Final = "fail"
ALLOW: Final = "allow"
#: Maximum number of requests in a failure.
_MOST: Final = 10


class Servers:
    """Starts fake PLCs: ``s7_server("pump")``. They end with the test."""

    def __init__(self, captures: CaptureFolder) -> None:
        self._captures = captures
        self._made: list[Server] = []
        self._watched: dict[int, int] = {}  # number of unmatched requests of a server that were already reported

    def __call__(
        self,
        what: object,
        *,
        unmatched: str = FAIL,
        repeat: str = "last",
        memory: bool = False,
        latency_ms: float | None = 0,
        faults: Sequence[Fault | str] | Fault | str = (),
    ) -> Server:
        """Serve a capture or a golden on a free local port; the server has ``host`` and ``port``.

        ``what`` is a name in the captures' folder, a path, a capture or a recorder. With ``unmatched="allow"`` a request
        without a recorded match does not fail the test. For the other options see
        `dissect.testing.playback.server.service.Server`.
        """
        __tracebackhide__ = True
        if unmatched not in {FAIL, ALLOW}:
            raise ValueError(f"unmatched is {FAIL!r} or {ALLOW!r}, not {unmatched!r}")
        try:
            path = path_of(what, self._captures)
            server = Server(path, repeat=repeat, memory=memory, latency_ms=latency_ms, faults=faults)
        except MISTAKES as mistake:
            raise mistake.with_traceback(None) from None
        if unmatched == FAIL:
            self._watched[len(self._made)] = 0
        self._made.append(server)
        server.start()
        return server

    def has_unmatched(self) -> bool:
        """Return whether there are requests without a recorded match that were not reported yet."""
        return any([self._made[number].log.unmatched_total > before for number, before in self._watched.items()])

    def complaint(self) -> str:
        """Return a report of requests without a recorded match, empty for none; each is reported once."""
        lines = []
        for number, before in self._watched.items():
            server = self._made[number]
            total = server.log.unmatched_total
            if total == before:
                continue
            self._watched[number] = total
            lines.append(f"the fake PLC of {near(server.recording.name)} received a request that was not recorded:")
            new = list(server.unmatched)[before - total :]
            lines += [f"  {printable(str(request))}" for request in new[:_MOST]]
            if total - before > _MOST:
                lines.append(f"  and {total - before - _MOST} more")
        if lines:
            lines.append('Record it as well, or use s7_server(..., unmatched="allow") if that is intended.')
        return "\n".join(lines)

    def close(self) -> None:
        """Close all servers; raise the error that broke one off."""
        for server in self._made:
            server.close()
        for server in self._made:
            if server.error is not None:
                raise server.error
