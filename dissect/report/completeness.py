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
    "fragment_waiting": "fragments of datagrams that never became whole",
    "fragment_dropped": "dropped fragments",
    "other_protocol": "of TCP connections that do not speak ISO-on-TCP",
    "before_start": "from before the first byte seen of their connection",
    "after_close": "after the end of their connection",
    "reset_ignored": "resets that were not believed",
    "cut": "cut before the end of their headers",
    "bad_header": "with impossible headers",
    "bad_checksum": "with a wrong TCP or UDP checksum",
    "link_type": "of a link type that is not supported",
    "failed": "the analyzer failed on",
}


def completeness(pipeline: Pipeline) -> Iterator[tuple[str, str]]:
    """Yield sentences without a full stop, each with its style: plain or a warning."""
    counts = pipeline.counters.packet_counts()
    used = sum(counts[name] for name in CATEGORIES[:FIRST_IGNORED])
    repeated = counts["retransmission"] + counts["keep_alive"]
    again = f", {words.count(repeated, 'of them a repetition', 'of them repetitions')} on TCP level" if repeated else ""
    yield f"{used} of {words.count(pipeline.frames, 'packet')} used{again}", _PLAIN
    for name in CATEGORIES[FIRST_IGNORED:]:
        if counts[name]:
            yield f"{counts[name]} not used: {_IGNORED[name]}", _PLAIN
    if pipeline.counters.cut_frames:
        yield f"{words.count(pipeline.counters.cut_frames, 'packet')} cut by the capture (snaplen)", _WARNING
    octets = pipeline.counters.octets
    if octets.holes:
        holes = words.count(octets.holes, "hole")
        missing = words.count(octets.missing, "octet")
        yield f"{holes} in the TCP streams, {missing} missing from the capture", _WARNING
    else:
        yield "no hole in the TCP streams", _PLAIN
    if octets.skipped:
        yield f"{words.count(octets.skipped, 'octet')} skipped that belong to no message", _WARNING
    if octets.buffered:
        yield f"{words.count(octets.buffered, 'octet')} of unfinished messages at the end", _PLAIN
    evicted = pipeline.exchange.watch.operations.evicted
    if evicted:
        yield f"{words.count(evicted, 'operation')} followed no further: too many at once", _WARNING
    forgotten = pipeline.connections.scans.forgotten
    if forgotten:
        pairs = words.count(forgotten, "pair")
        yield f"{pairs} of client and server no longer watched for TSAP scans: too many", _WARNING
