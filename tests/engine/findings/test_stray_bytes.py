"""Stray bytes between TPKTs: a stretch is told once, whole, and whether decoding resumed."""

from __future__ import annotations

from pathlib import Path

import dissect
from tests.engine.transactions.talk import ACK, CLIENT, FIN, SERVER, Talk, dbw, dt, read, words

FOUND = "tpkt.garbage"


def opened() -> Talk:
    talk = Talk()
    talk.open()
    return talk


def told(talk: Talk) -> list[tuple[list[int], str]]:
    talk.pipeline.exchange.report_findings()
    return [(one.frames, one.detail) for one in talk.findings if one.slug == FOUND]


def test_a_stretch_over_several_packets() -> None:
    talk = opened()
    first = talk.packet(CLIENT, b"\xff" * 50)
    last = talk.packet(CLIENT, b"\xfe" * 30)
    assert told(talk) == []
    resumed = talk.ask(read(1, dbw(1, 0)))
    expected = [([first, last], f"80 bytes from 10.0.0.1:50000, first 0xff; decoding resumed in packet {resumed}")]
    assert told(talk) == expected
    talk.tell(words(1, 1))
    talk.close()
    assert talk.outcomes() == ["answered"]
    assert told(talk) == expected


def test_several_stretches_in_one_packet() -> None:
    talk = opened()
    frame = talk.packet(CLIENT, b"\xff" * 5 + dt(read(1, dbw(1, 0))) + b"\x00" * 7 + dt(read(2, dbw(1, 0))))
    resumed = f"; decoding resumed in packet {frame}"
    assert told(talk) == [
        ([frame], f"5 bytes from 10.0.0.1:50000, first 0xff{resumed}"),
        ([frame], f"7 bytes from 10.0.0.1:50000, first 0x00{resumed}"),
    ]


def test_decoding_that_does_not_resume() -> None:
    """The header with a wrong length is the beginning of it."""
    talk = opened()
    first = talk.packet(SERVER, b"\x03\0\0\x05\0\xd0\x80")
    last = talk.packet(SERVER, b"\x03\0\0\x07\0\x0f\x80\xa9\0")
    talk.packet(CLIENT)
    talk.close()
    assert told(talk) == [([first, last], "16 bytes from 10.0.0.2:102, first 0x03; decoding did not resume")]
    assert talk.pipeline.counters.octets.skipped == 16


def test_a_wrong_length_alone_is_no_stretch() -> None:
    talk = opened()
    talk.packet(SERVER, b"\x03\0\0\x05\0" + dt(words(9, 1)))
    talk.close()
    assert told(talk) == []
    assert "tpkt.bad_length" in talk.slugs()


def test_a_long_stretch_is_told_while_it_goes_on() -> None:
    talk = opened()
    first = int(talk.pipeline.frames) + 1
    for _ in range(100):
        talk.packet(CLIENT, b"\xff" * 1400)
    (only,) = told(talk)
    assert only == ([first, first + 46], "65800 bytes from 10.0.0.1:50000, first 0xff so far")
    talk.packet(CLIENT, flags=FIN | ACK)
    talk.finish()
    assert told(talk) == [only]


def test_a_shared_capture(corpus: Path) -> None:
    analysis = dissect.analyze(corpus / "mms_one_sided_read_request.pcap")
    found = [(one.frames, one.detail) for one in analysis.findings if one.slug == FOUND]
    assert found == [([6, 14], "35 bytes from 127.0.0.1:102, first 0x03; decoding did not resume")]
