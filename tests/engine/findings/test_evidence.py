"""A finding about a connection cites packets of that connection, and those that show what it says."""

from __future__ import annotations

from pathlib import Path

import pytest

import dissect
from dissect.protocols.s7plus.tables import EXPLORE
from tests.engine.findings.test_plus_rules import begun, explore
from tests.engine.transactions.talk import ACK, CLIENT, FIN, SERVER, Talk, dbw, dt, read, words


def test_looking_around_is_shown_by_the_first_and_the_last_explore() -> None:
    talk = begun()
    for number in range(1, 6):
        explore(talk, number)
    explored = [one for one in talk.transactions if one.function == EXPLORE]
    talk.close()
    (found,) = [one for one in talk.findings if one.slug == "security.reconnaissance"]
    assert found.detail.endswith("5 Explore requests and no subscription")
    assert found.frames == [explored[0].request_frame, explored[-1].request_frame]
    assert found.time_ns == explored[-1].request_ns


def other(talk: Talk) -> None:
    """Another connection goes on in the same capture."""
    beside = Talk(client_port=50001, beside=talk)
    beside.open()
    for number in (1, 2):
        beside.ask(read(number, dbw(1, 0)))
        beside.tell(words(number, 1))


@pytest.mark.parametrize("closed", [False, True])
def test_one_direction_is_shown_by_packets_of_the_connection(closed: bool) -> None:
    talk = Talk()
    first, _, last = [talk.ask(read(number, dbw(1, 0))) for number in (1, 2, 3)]
    if closed:
        last = talk.packet(CLIENT, flags=FIN | ACK)
    other(talk)
    talk.finish()
    (found,) = [one for one in talk.findings if one.slug == "capture.one_sided"]
    assert found.frames == [first, last]


@pytest.mark.parametrize("slug", ["tpkt.unfinished", "cotp.unfinished_tsdu"])
def test_what_never_ends_is_shown_by_packets_of_the_connection(slug: str) -> None:
    talk = Talk()
    talk.open()
    whole = dt(words(1, 1, 2, 3))
    begun_ = whole[:-2] if slug == "tpkt.unfinished" else whole[:6] + b"\0" + whole[7:]
    last = talk.packet(SERVER, begun_)
    other(talk)
    talk.finish()
    assert [one.frames for one in talk.findings if one.slug == slug] == [[last]]


def test_shared_capture(corpus: Path) -> None:
    found = [one for one in dissect.analyze(corpus / "s7plus/plc.pcap").findings if "Explore" in one.detail]
    assert [one.frames for one in found] == [[47, 110], [207, 272], [331, 394]]
