"""What became of the packets and octets of a run, for a person: what was used, what is missing, what had to be given up."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from dissect.engine.pipeline import Pipeline
from dissect.report import words
from dissect.transactions.accounts import CATEGORIES, FIRST_IGNORED

_PLAIN: Final = ""
_WARNING: Final = "warning"

#: How packets that were not used are called.
_IGNORED: Final = {
    "not_ip": "not IP",
    "not_tcp": "IP but not TCP",
    "fragment_waiting": "fragments of incomplete datagrams",
    "fragment_dropped": "dropped fragments",
    "other_protocol": "TCP connections without ISO-on-TCP",
    "before_start": "before the first captured byte of their connection",
    "after_close": "after the end of their connection",
    "reset_ignored": "RST or FIN outside the receive window",
    "cut": "truncated inside their headers",
    "bad_header": "invalid headers",
    "bad_checksum": "wrong TCP or UDP checksum",
    "link_type": "unsupported link type",
    "failed": "packets the analyzer failed on",
    "left_out": "connections that are not selected",
}


def completeness(pipeline: Pipeline) -> Iterator[tuple[str, str]]:
    """Yield sentences without a full stop, each with its style: plain or a warning."""
    counts = pipeline.counters.packet_counts()
    used = sum(counts[name] for name in CATEGORIES[:FIRST_IGNORED])
    repeated = counts["retransmission"] + counts["keep_alive"]
    kind = "retransmission or keep-alive" if counts["keep_alive"] else "retransmission"
    kinds = "retransmissions or keep-alives" if counts["keep_alive"] else "retransmissions"
    again = f", {words.count(repeated, f'of them a TCP {kind}', f'of them TCP {kinds}')}" if repeated else ""
    yield f"{used} of {words.count(pipeline.frames, 'packet')} used{again}", _PLAIN
    for name in CATEGORIES[FIRST_IGNORED:]:
        if counts[name]:
            yield f"{counts[name]} ignored: {_IGNORED[name]}", _PLAIN
    if pipeline.counters.cut_frames:
        yield f"{words.count(pipeline.counters.cut_frames, 'packet')} truncated by the capture (snaplen)", _WARNING
    octets = pipeline.counters.octets
    if octets.holes:
        holes = words.count(octets.holes, "gap")
        missing = words.count(octets.missing, "byte")
        yield f"{holes} in the TCP streams, {missing} missing from the capture", _WARNING
    else:
        yield "no gaps in the TCP streams", _PLAIN
    if octets.skipped:
        verb = "belongs" if octets.skipped == 1 else "belong"
        yield f"{words.count(octets.skipped, 'byte')} skipped that {verb} to no message", _WARNING
    if octets.buffered:
        yield f"{words.count(octets.buffered, 'byte')} of unfinished messages at the end", _PLAIN
    evicted = pipeline.exchange.watch.operations.evicted
    if evicted:
        yield f"{words.count(evicted, 'operation')} no longer tracked: too many at once", _WARNING
    forgotten = pipeline.connections.scans.forgotten
    if forgotten:
        pairs = words.count(forgotten, "pair")
        yield f"{pairs} of client and server no longer watched for TSAP scans: too many", _WARNING
