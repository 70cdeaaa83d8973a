"""One TSAP after another: who does it, how many, how fast, and how much of it is remembered."""

from __future__ import annotations

from dissect.engine.findings.reporter import Reporter
from dissect.engine.findings.scan_rules import MAX_PAIRS, MAX_TSAPS, REFUSED, TSAPS, WINDOW_NS, ScanWatch
from dissect.engine.transactions.connection import Connection
from dissect.packets.tcp.connection import TcpConnection
from dissect.packets.tcp.stream import Endpoint
from dissect.protocols.iso.tsap import Tsap

SERVER = b"\x0a\0\0\x02"


def asking(tsap: int | None, client: int = 1, server: bytes = SERVER) -> Connection:
    """A connection with a connect request for TSAP 01.``tsap``."""
    tcp = TcpConnection(Endpoint(client.to_bytes(4, "big"), 50000), Endpoint(server, 102), 0, 1, 0)
    connection = Connection(1, tcp)
    connection.tsap_called = Tsap(bytes((1, tsap))) if tsap is not None else None
    return connection


def test_many_tsaps_are_a_scan_whatever_the_answer() -> None:
    judge = Reporter()
    watch = ScanWatch(judge)
    for number in range(TSAPS):
        assert judge.fresh == []
        watch.asked(asking(number), 10 + number, number * 1_000_000_000)
    (finding,) = judge.fresh
    assert (finding.slug, finding.frames) == ("security.tsap_scan", [10, 11, 12, 13, 14, 15])
    said = "0.0.0.1:50000 tried 6 TSAPs of 10.0.0.2:102 within 5.00 s, 0 of them refused: 01.00, 01.01, 01.02"
    assert finding.detail.startswith(said)
    watch.asked(asking(99), 99, TSAPS * 1_000_000_000)
    assert judge.counts == {"security.tsap_scan": 1}


def test_few_refusals_are_enough() -> None:
    judge = Reporter()
    watch = ScanWatch(judge)
    for number in range(REFUSED):
        assert judge.fresh == []
        watch.asked(asking(number), number, 0)
        watch.refused(asking(number), 0)
    assert len(judge.fresh) == 1


def test_one_tsap_is_no_scan_and_none_neither() -> None:
    judge = Reporter()
    watch = ScanWatch(judge)
    for number in range(100):
        watch.asked(asking(2), number, number)
        watch.refused(asking(2), number)
        watch.asked(asking(None), number, number)
        watch.refused(asking(None), number)
    assert judge.fresh == []


def test_each_server_counts_for_itself() -> None:
    judge = Reporter()
    watch = ScanWatch(judge)
    for number in range(100):
        watch.asked(asking(number % 5, server=bytes((10, 0, 1, number))), number, number)
    assert judge.fresh == []


def test_who_takes_his_time_is_no_scanner() -> None:
    judge = Reporter()
    watch = ScanWatch(judge)
    for number in range(20):
        watch.asked(asking(number), number, number * WINDOW_NS // 4)
    assert judge.fresh == []


def test_a_clock_that_runs_backwards_begins_a_new_window() -> None:
    judge = Reporter()
    watch = ScanWatch(judge)
    for number in range(20):
        watch.asked(asking(number), number, -number)
    assert judge.fresh == []


def test_what_is_remembered_is_bounded() -> None:
    judge = Reporter()
    watch = ScanWatch(judge)
    for number in range(MAX_PAIRS + 10):
        watch.asked(asking(1, client=number), number, 0)
    assert (len(watch._pairs), watch.forgotten) == (MAX_PAIRS, 10)
    watch.refused(asking(1, client=0), 0)  # one that had to leave: a refusal alone brings no pair back
    assert watch.forgotten == 10
    for number in range(256):
        watch.asked(asking(number, client=7_000_000), number, 0)
    (pair,) = [pair for pair in watch._pairs.values() if len(pair.asked) > 1]
    assert len(pair.asked) == MAX_TSAPS
