"""What had to be given up is told (what is used and missing: tests/meaning/report/test_text.py, on whole reports)."""

from __future__ import annotations

from dissect.engine.findings.scan_rules import MAX_PAIRS
from dissect.engine.transactions.operation import MAX_OPEN
from dissect.meaning.report.analysis import Analysis
from tests.engine.findings import events
from tests.meaning.report.support import analysed, begun, report, section
from tests.properties import messages
from tests.properties.messages import dt
from tests.properties.packets import Flow, Packet, Talk


def loss(analysis: Analysis, key: str) -> object:
    told = analysis.as_dict()["loss"]
    assert isinstance(told, dict)
    return told[key]


def test_what_is_followed_no_further_is_told() -> None:
    talk = begun()
    for number in range(MAX_OPEN + 2):
        asked, told = events.asks(number, 2, 1, events.CYCLIC), events.tells(number, 2, 1, b"\0\0\0\0", number)
        talk.send(0, dt(asked)).send(1, dt(told))
    analysis = analysed(talk.packets())
    assert section(report(analysis), "Completeness")[-1] == "2 operations no longer tracked: too many at once"
    assert (loss(analysis, "operations_evicted"), loss(analysis, "scan_pairs_forgotten")) == (2, 0)


def test_pairs_that_are_no_longer_watched_are_told() -> None:
    talks = [Talk(Flow(f"10.0.{number >> 8}.{number & 255}", "10.9.9.9")) for number in range(MAX_PAIRS + 1)]
    packets = [packet for talk in talks for packet in talk.handshake().send(0, messages.connect(0xE0)).packets()]
    analysis = analysed(packets)
    told = "1 pair of client and server no longer watched for TSAP scans: too many"
    assert told in section(report(analysis), "Completeness")
    assert (loss(analysis, "operations_evicted"), loss(analysis, "scan_pairs_forgotten")) == (0, 1)


def test_connections_without_data_are_told() -> None:
    talk = Talk().handshake().close()
    analysis = analysed(talk.packets())
    told = "1 connection to port 102 opened and closed without data, as port scans do: it begins with packet 1"
    assert told in section(report(analysis), "Completeness")
    assert analysis.as_dict()["connections_without_data"] == 1


def test_who_closed_a_connection_of_which_only_the_end_was_captured() -> None:
    def closing(number: int, side: int) -> list[Packet]:
        whole = Talk(Flow(ports=(50000 + number, 102))).handshake().close(side).packets()
        return whole[3:]

    one = section(report(analysed(closing(1, 1))), "Completeness")
    told = "1 connection to port 102 of which only the end was captured, closed"
    assert f"{told} by the server (packet 1)" in one
    three = [packet for number, side in ((1, 0), (2, 1), (3, 1)) for packet in closing(number, side)]
    told = "3 connections to port 102 of which only the end was captured, closed"
    assert f"{told} 2 by the server, 1 by the client (the first at packet 1)" in section(
        report(analysed(three)), "Completeness"
    )
