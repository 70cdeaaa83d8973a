"""tshark as a child process: its JSON, one packet after another.

``-T json -x --no-duplicate-keys`` is the exact form: every field with its octets and its position, and a list if a name occurs
more than once.
"""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Callable, Iterable, Iterator
from typing import IO, Any, Final

import msgspec

from dissect.engine.transactions.connection import ISO_TSAP_PORT
from dissect.testing.oracle.theirs import PROTOCOLS, Frame

PROGRAM: Final = "tshark"
#: Only packets with a TPKT matter.
FILTER: Final = "tpkt"
#: Set on the command line, so that a user's own preferences have no effect.
PREFERENCES: Final = {
    "tcp.desegment_tcp_streams": "TRUE",
    "tcp.analyze_sequence_numbers": "TRUE",
    "tcp.check_checksum": "FALSE",
    "ip.defragment": "TRUE",
    "ip.check_checksum": "FALSE",
    "tpkt.desegment": "TRUE",
    "cotp.reassemble": "TRUE",
}
_CHUNK: Final = 1 << 18
#: The form in which tshark prints an array: each record begins and ends at two spaces, its contents are indented deeper.
_BEGIN: Final = b"\n  {"
_END: Final = b"\n  }"


class OracleError(Exception):
    """Wireshark cannot be run; the message says why and what to do."""


#: Reads a capture: (path, ports to treat as TPKT, whether TCP segments are put in order first) → packets.
Reader = Callable[[str, Iterable[int], bool], Iterator[Frame]]


def preferences(ports: Iterable[int], reorder: bool) -> dict[str, str]:
    """Return Wireshark's preferences: ``ports`` are treated as TPKT besides 102, ``reorder`` puts TCP segments in order first.

    decode-as (``-d tcp.port==N,tpkt``) does not work for the ports: two dissectors have that name, and the one it selects, a
    heuristic of RDP, misses a message whose TPKT header is split between segments.
    """
    return {
        **PREFERENCES,
        "tpkt.tcp.port": ",".join(str(port) for port in sorted({ISO_TSAP_PORT, *ports})),
        "tcp.reassemble_out_of_order": "TRUE" if reorder else "FALSE",
    }


def _command(path: str, ports: Iterable[int], reorder: bool) -> list[str]:
    command = [PROGRAM, "-n", "-r", path]
    for name, value in preferences(ports, reorder).items():
        command += ["-o", f"{name}:{value}"]
    return command


class Child:
    """A running program whose output is read from ``stdout``; ``what`` names its task in messages."""

    def __init__(self, command: list[str], what: str) -> None:
        self._what = what
        self._complaints: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115 - open as long as the child runs
        try:
            self._process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=self._complaints
            )
        except OSError as error:
            self._complaints.close()
            message = (
                f"{what}: {command[0]} cannot be started ({error.strerror}); install it (Debian: apt install tshark)"
            )
            raise OracleError(message) from error
        assert self._process.stdout is not None
        self.stdout: IO[bytes] = self._process.stdout

    def close(self, stop: bool = False) -> None:
        """Wait for the end; with ``stop``, terminate it and ignore its status, otherwise raise OracleError if it failed."""
        if stop:
            self._process.terminate()
        self.stdout.close()
        code = self._process.wait()
        self._complaints.seek(0)
        complaints = self._complaints.read().decode("utf-8", "replace").strip().splitlines()
        self._complaints.close()
        if code and not stop:
            # The last line is the reason; before it come warnings.
            raise OracleError(
                f"{self._what}: it failed with code {code}: {complaints[-1] if complaints else 'it does not say why'}"
            )


def version() -> str:
    """Return tshark's version, as ``4.0.17``. Raises OracleError if tshark is missing."""
    child = Child([PROGRAM, "--version"], "the comparison needs tshark")
    output = child.stdout.read().decode("utf-8", "replace")
    child.close()
    return next((word for word in output.split() if word[0].isdigit()), "of an unknown version")


def records(stream: IO[bytes]) -> Iterator[bytes]:
    """Split tshark's JSON array into its records, each a whole object; only one record and one chunk are in memory."""
    held = bytearray()
    while chunk := stream.read1(_CHUNK) if hasattr(stream, "read1") else stream.read(_CHUNK):
        scan = max(0, len(held) - len(_END))
        held += chunk
        while (end := held.find(_END, scan)) >= 0:
            begin = held.find(_BEGIN)
            yield bytes(held[begin : end + len(_END)])
            del held[: end + len(_END)]
            scan = 0


def read_tshark(path: str, ports: Iterable[int] = (), reorder: bool = False) -> Iterator[Frame]:
    """Dissect a capture with tshark and yield every packet that contains a TPKT.

    ``ports`` besides 102 are treated as TPKT. Raises OracleError if tshark is missing, or (after the last packet) if it fails.
    """
    command = _command(path, ports, reorder)
    command += ["-Y", FILTER, "-T", "json", "-x", "-J", " ".join(PROTOCOLS), "--no-duplicate-keys"]
    child = Child(command, f"tshark, reading {path}")
    whole = False
    try:
        decode = msgspec.json.Decoder(dict[str, Any]).decode
        for record in records(child.stdout):
            yield Frame(decode(record)["_source"]["layers"])
        whole = True
    finally:
        child.close(stop=not whole)


class Segment:
    """A TCP segment with payload: its direction (``flow``), absolute sequence number, payload, and tshark's remarks on it.

    ``protocols`` are those that tshark finds in its packet.
    """

    __slots__ = ("flow", "frame", "payload", "protocols", "remarks", "sequence")

    def __init__(
        self,
        frame: int,
        flow: str,
        sequence: int,
        payload: bytes,
        remarks: frozenset[str],
        protocols: frozenset[str] = frozenset(),
    ) -> None:
        self.frame = frame
        self.flow = flow
        self.sequence = sequence
        self.payload = payload
        self.remarks = remarks
        self.protocols = protocols

    @property
    def stream(self) -> str:
        """The stream of both directions of its connection: tshark's number of the TCP stream."""
        return self.flow.partition(" ")[0]


_FLOW: Final = ("tcp.stream", "ieee8021ad.id", "vlan.id", "ip.src", "ipv6.src", "tcp.srcport")
#: Wireshark's remarks on a segment that it does not regard as the next one.
_REMARKS: Final = (
    "tcp.analysis.retransmission",
    "tcp.analysis.fast_retransmission",
    "tcp.analysis.spurious_retransmission",
    "tcp.analysis.out_of_order",
    "tcp.analysis.lost_segment",
    "tcp.analysis.keep_alive",
)


def read_segments(path: str) -> Iterator[Segment]:
    """Yield every TCP segment with payload, in the order of the file. Raises OracleError as `read_tshark` does."""
    names = ["frame.number", "tcp.seq_raw", "tcp.payload", "frame.protocols", *_FLOW, *_REMARKS]
    command = [*_command(path, (), False), "-Y", "tcp.payload", "-T", "fields", "-E", "occurrence=a"]
    for name in names:
        command += ["-e", name]
    child = Child(command, f"tshark, reading {path}")
    whole = False
    try:
        for line in child.stdout:
            values = dict(zip(names, line.decode("ascii").rstrip("\n").split("\t"), strict=True))
            yield Segment(
                int(values["frame.number"]),
                " ".join(values[name] for name in _FLOW),  # all VLAN tags of a packet belong to it
                int(values["tcp.seq_raw"]),
                bytes.fromhex(values["tcp.payload"].replace(":", "")),
                frozenset(name for name in _REMARKS if values[name]),
                frozenset(values["frame.protocols"].split(":")),
            )
        whole = True
    finally:
        child.close(stop=not whole)
