"""Connection attempts: a SYN that the other side answers, refuses or leaves unanswered.

A missing answer proves nothing, because the capture may show one direction only. But a client that repeats its SYN has got no
answer. So an attempt is reported if its SYN was repeated and nothing followed: at the second repetition, or after one
repetition when another attempt takes its place or the capture ends. A single SYN is never reported.
"""

from __future__ import annotations

from mypy_extensions import i64

from dissect.engine.counters import Counters
from dissect.engine.findings.crowd import open_to
from dissect.engine.transactions.connection import ISO_TSAP_PORT
from dissect.engine.transactions.table import Attempt, ConnectionTable, base_and_tag, endpoints
from dissect.packets.tcp.link import within
from dissect.wire.text import duration_text


def note_syn(counters: Counters, table: ConnectionTable, key: bytes, seq: i64, link: bytes) -> None:
    """Take a SYN with ``key``; ``link`` is as in `TcpConnection.note_link`."""
    evicted: i64 = table.half_open_evicted
    given_up = table.note_syn(key, seq, counters.frames, counters.now_ns, link)
    if given_up is not None:
        _note_unanswered(counters, key, given_up)
    if table.half_open_evicted > evicted:
        counters.note("stream.half_open_evicted")


def note_reset(counters: Counters, table: ConnectionTable, key: bytes) -> None:
    """Take a RST with ``key`` that belongs to no connection: it may refuse an attempt; refusals on port 102 are reported."""
    if table.refused(key):
        server, client = endpoints(key)
        if server.port != ISO_TSAP_PORT:
            return
        vlan: i64 = int.from_bytes(base_and_tag(key)[1], "big")
        if counters.wants_between("stream.refused", within(client.host, vlan), within(server.host, vlan)):
            beside = open_to(table, client, server, vlan)
            counters.detail("stream.refused", f"{server} refuses {client}{beside}")


def finish(counters: Counters, table: ConnectionTable) -> None:
    """The capture ends: report repeated attempts that are still unanswered."""
    for key, attempt in table.unanswered():
        _note_unanswered(counters, key, attempt)


def _note_unanswered(counters: Counters, key: bytes, attempt: Attempt) -> None:
    client, server = endpoints(key)
    if server.port == ISO_TSAP_PORT:
        span = duration_text(int(attempt.last_ns - attempt.time_ns))
        frames = [int(attempt.frame), int(attempt.last_frame)]
        vlan: i64 = int.from_bytes(base_and_tag(key)[1], "big")
        counters.note_between(
            "stream.unanswered",
            within(client.host, vlan),
            within(server.host, vlan),
            frames,
            attempt.last_ns,
            f"{server} does not answer {client} within {span}",
        )
