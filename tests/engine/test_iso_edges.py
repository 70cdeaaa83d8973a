"""ISO-on-TCP, TPDU by TPDU: each kind and its faults, messages in parts, and streams that are cut anywhere."""

from __future__ import annotations

from typing import Any, Final

import pytest

from dissect.engine import iso
from dissect.engine.transactions.side import Side
from dissect.protocols.iso.cotp import MAX_EXPEDITED
from dissect.wire.build import COMPILED
from tests import build
from tests.cases import each
from tests.engine.transactions.talk import (
    ACK,
    CLIENT,
    CONFIRM,
    CONNECT,
    FIN,
    RST,
    SECOND,
    SERVER,
    Talk,
    dbw,
    dt,
    granted,
    read,
    setup,
    words,
)
from tests.protocols.s7plus.pdus import asked, framed, told

WHO: Final = {CLIENT: "10.0.0.1:50000", SERVER: "10.0.0.2:102"}
EMPTY: Final = build.dt(b"", eot=False)


class Looking(Talk):
    """Sees each TPDU."""

    def __init__(self) -> None:
        super().__init__()
        self.wants_tpdus = True
        self.tpdus: list[tuple[int, bytes]] = []

    def tpdu(self, frame: int, time_ns: int, side: Side, octets: bytes) -> None:
        self.tpdus.append((int(side.index), octets))


def begun(kind: type[Talk] = Talk) -> Talk:
    talk = kind()
    talk.hello()
    talk.connect()
    return talk


def opened(kind: type[Talk] = Talk) -> Talk:
    talk = kind()
    talk.open(8, 8)
    return talk


def details(talk: Talk, slug: str) -> list[str]:
    return [one.detail for one in talk.findings if one.slug == slug]


def tpdus(talk: Talk) -> Any:
    return talk.pipeline.iso.describe()["tpdus"]


def tsdus(talk: Talk) -> Any:
    found: Any = talk.pipeline.iso.describe()["tsdus"]
    return {name: count for name, count in found.items() if count}


# ---- streams that are cut anywhere ----------------------------------------------------------------------------------

#: A conversation with all that is usual, and messages in parts.
SAID: Final = [
    (CLIENT, CONNECT),
    (SERVER, CONFIRM),
    (CLIENT, dt(setup(0, 8, 8))),
    (SERVER, dt(granted(0, 8, 8))),
    (CLIENT, EMPTY + dt(read(1, dbw(1, 0)))),
    (SERVER, EMPTY + dt(words(1, 1)) + EMPTY),
    (CLIENT, dt(read(2, dbw(1, 0)), read(3, dbw(1, 2)))),
    (SERVER, dt(words(2, 1)) + build.dt(words(3, 2)[:9], eot=False) + build.dt(words(3, 2)[9:])),
    (CLIENT, build.dt(read(4, dbw(1, 0)), number=5)),
    (SERVER, dt(words(4, 7))),
    (CLIENT, dt(framed(asked(1)))),
    (SERVER, dt(framed(told(1)))),
    (CLIENT, build.dt(b"", eot=False) * 3),
    (CLIENT, build.tpdu(b"\x80\x00\x00\x00\x00\x80")),
]


def heard(talk: Talk) -> Any:
    """All that is told, but for packets and times."""
    pipeline = talk.pipeline
    return (
        [
            (one.function_name, one.outcome, one.request_octets, one.response_octets, one._flags)
            for one in talk.transactions
        ],
        sorted([(one.slug, one.detail) for one in talk.findings if one.slug != "cotp.empty_dt"]),
        pipeline.iso.describe(),
        pipeline.s7.describe(),
        pipeline.plus.describe(),
        pipeline.counters.octets.as_dict(),
        [(one.pdus, one.answered, one.protocol, one.iso_ended) for one in talk.connections],
    )


def sent(kind: type[Talk], pieces: list[tuple[int, bytes]]) -> Any:
    talk = kind()
    talk.hello()
    for side, octets in pieces:
        talk.packet(side, octets)
    talk.close()
    return heard(talk), talk.tpdus if isinstance(talk, Looking) else None


@pytest.fixture
def compiled_road(monkeypatch: pytest.MonkeyPatch) -> None:
    """The short road of the compiled build, which is plain Python as well."""
    monkeypatch.setattr(iso, "COMPILED", True)


@pytest.mark.skipif(COMPILED, reason="compiled constants cannot be changed")
@pytest.mark.usefixtures("compiled_road")
@each("at", range(24))
def test_a_message_with_another_octet_is_read_alike_by_those_who_look(at: int) -> None:
    """From the first octet of its TPKT to the first behind the header of its PDU; looking takes the long road."""
    for octet in (0x07, 0x32):
        for answer in (False, True):
            found = []
            for kind in (Talk, Looking):
                talk = opened(kind)
                talk.ask(read(1, dbw(1, 0)))
                talk.tell(words(1, 1))
                for side, pdu in ((CLIENT, dt(read(2, dbw(1, 0)))), (SERVER, dt(words(2, 1)))):
                    other = pdu[:at] + bytes((octet,)) + pdu[at + 1 :] if (side == SERVER) is answer else pdu
                    talk.packet(side, other)
                talk.ask(read(3, dbw(1, 0)))
                talk.tell(words(3, 1))
                talk.close()
                found.append(heard(talk))
            assert found[0] == found[1], (octet, answer)


@pytest.mark.parametrize("kind", [Talk, Looking])
def test_it_does_not_matter_where_streams_are_cut(kind: type[Talk]) -> None:
    """Each message in two segments, for each place of the cut, and in pieces of each size; those who look see the same."""
    right = sent(kind, SAID)
    for at in range(1, 45, 1 if kind is Talk else 3):
        pieces = [(side, piece) for side, octets in SAID for piece in (octets[:at], octets[at:]) if piece]
        assert sent(kind, pieces) == right, at
    for size in (1, 2, 3, 5, 7, 8, 16, 17):
        pieces = [(side, octets[at : at + size]) for side, octets in SAID for at in range(0, len(octets), size)]
        assert sent(kind, pieces) == right, size


@pytest.mark.parametrize("kind", [Talk, Looking])
def test_requests_and_answers_may_come_together(kind: type[Talk]) -> None:
    """Everything that one side says before the other one answers, in one segment or in segments across its messages."""
    pdus = [dt(read(ref, dbw(1, ref))) for ref in range(1, 7)]
    answers = [dt(words(ref, ref)) for ref in range(1, 7)]
    found = []
    for size in (10_000, 31, 62, 40, 20, 7):
        talk = opened(kind)
        for side, octets in ((CLIENT, b"".join(pdus)), (SERVER, b"".join(answers))):
            for at in range(0, len(octets), size):
                talk.packet(side, octets[at : at + size])
        talk.close()
        found.append(heard(talk))
    assert found == found[:1] * len(found)
    assert [outcome for _, outcome, *_ in found[0][0]] == ["answered"] * 6


# ---- kinds of TPDUs -------------------------------------------------------------------------------------------------


def test_tpdus_are_counted_by_their_type() -> None:
    talk = opened()
    for tpdu in (
        b"\x02\xf0\x80", b"\x02\xf0\x00", b"\x04\x10\x00\x00\x80", b"\x04\x10\x00\x00\x80",
        b"\x06\x70\x00\x00\x00\x01\x00", b"\x03\x30\x00\x00", b"\x06\x80\x00\x00\x00\x00\x80",
    ):  # fmt: skip
        talk.packet(SERVER, build.tpkt(tpdu))
    found = tpdus(talk)
    assert sum(found.values()) == 2 + 2 + 7
    assert found["DT"] == 4
    assert found["ED"] == 2
    assert (found["CR"], found["CC"], found["DR"], found["ER"]) == (1, 1, 1, 1)


def test_the_section_has_what_is_often_asked_for_even_where_it_is_zero() -> None:
    talk = Talk()
    assert talk.pipeline.iso.describe() == {
        "tsdus": {"s7comm": 0, "s7comm_plus": 0, "mms": 0, "tls": 0, "unknown": 0},
        "tpdus": {},
    }
    talk = opened()
    for tsdu in (b"", b"what", b"\x01\x00\x01\x00\x61\x00", b"\x16\x03\x01\x00\x01a", framed(asked(1))):
        talk.packet(CLIENT, dt(tsdu))
    assert tsdus(talk) == {"s7comm": 2, "s7comm_plus": 1, "mms": 1, "tls": 1, "unknown": 1, "empty": 1}


@each("reserved", [1, 0x80, 0xFF])
@each("side", [CLIENT, SERVER])
def test_a_reserved_octet_is_reported_and_its_tpkt_read(reserved: int, side: int) -> None:
    talk = opened()
    octets = dt(read(1, dbw(1, 0)))
    frame = talk.packet(side, octets[:1] + bytes((reserved,)) + octets[2:])
    talk.finish()
    found = [(one.detail, one.frames) for one in talk.findings if one.slug == "tpkt.reserved"]
    assert found == [(f"0x{reserved:02x} from {WHO[side]}", [frame])]
    assert talk.outcomes() == ["unanswered"]


@each("size", [MAX_EXPEDITED - 1, MAX_EXPEDITED, MAX_EXPEDITED + 1])
def test_expedited_data_are_short(size: int) -> None:
    """16 octets (X.224); they are part of no message."""
    talk = opened()
    talk.packet(SERVER, build.tpdu(b"\x10\x00\x00\x80", data=bytes(size)))
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(words(1, 1))
    assert details(talk, "cotp.expedited_too_long") == ([f"{size} bytes from {WHO[SERVER]}"] if size > 16 else [])
    assert talk.outcomes() == ["answered"]


@each("cause", [0, 1, 3])
def test_an_error_tpdu_is_reported_with_its_cause(cause: int) -> None:
    talk = opened()
    frame = talk.packet(SERVER, build.tpdu(b"\x70\x00\x00" + bytes((cause,))))
    talk.close()
    assert [one.frames for one in talk.findings if one.slug == "cotp.error"] == [[frame]]
    assert talk.connections[0].iso_ended.startswith(f"ER from {WHO[SERVER]}: ")


# ---- connect and confirm --------------------------------------------------------------------------------------------


def test_a_confirm_without_its_request_is_reported_where_the_request_cannot_be_missing() -> None:
    """The other side has sent something, nothing of it is missing, and the capture has the beginning."""
    for begin, gap, count in ((True, 0, 1), (True, 30, 0), (False, 0, 0)):
        talk = Talk()
        if begin:
            talk.hello()
        talk.packet(CLIENT, dt(b"what is this"))
        talk.seq[CLIENT] += gap
        if gap:
            talk.packet(CLIENT, dt(b"what is this"))
            talk.packet(SERVER)
            talk.silence(3 * SECOND)
        talk.packet(SERVER, CONFIRM)
        assert talk.slugs().count("cotp.answer_without_request") == count, (begin, gap)
    talk = Talk()
    talk.hello()
    talk.packet(SERVER, CONFIRM)  # of the other side nothing is there yet
    assert "cotp.answer_without_request" not in talk.slugs()


def test_a_connect_request_that_is_damaged_begins_no_other_connection() -> None:
    damaged = CONNECT[:4] + bytes((CONNECT[4] + 9,)) + CONNECT[5:]
    for octets, connections in ((damaged, 1), (CONNECT, 2)):
        talk = opened()
        talk.packet(CLIENT, octets)
        talk.close()
        assert len(talk.connections) == connections


def test_a_damaged_confirm_changes_nothing_of_an_established_connection() -> None:
    talk = opened()
    (side,) = talk.pipeline.table.all_open()
    before = (side.connection.tpdu_size, side.connection.class_)
    damaged = CONFIRM[:4] + bytes((CONFIRM[4] + 9,)) + CONFIRM[5:-1] + b"\x07"
    talk.packet(SERVER, damaged)
    assert (side.connection.tpdu_size, side.connection.class_) == before == (1024, 0)


def test_a_connect_request_behind_data_of_a_connection_met_in_its_midst_begins_another() -> None:
    """Behind its CC only it may be the one that was captured late."""
    for octets, connections in ((CONFIRM, 1), (dt(words(1, 1)), 2)):
        talk = Talk()
        talk.packet(SERVER, octets)
        talk.packet(CLIENT, CONNECT)
        talk.finish()
        assert len(talk.connections) == connections
        assert not talk.connections[-1].mid_stream


def test_a_repeated_connect_request_is_reported() -> None:
    talk = Talk()
    talk.hello()
    talk.packet(CLIENT, CONNECT)
    frame = talk.packet(CLIENT, CONNECT)
    talk.packet(SERVER, CONFIRM)
    assert [(one.slug, one.frames) for one in talk.findings] == [("cotp.repeated_request", [frame])]


# ---- messages in parts ----------------------------------------------------------------------------------------------


@each("plus", [False, True])
@each("parts", [2, 3, 9])
def test_a_message_in_parts_is_one(parts: int, plus: bool) -> None:
    """An empty DT among them changes nothing."""
    talk = opened()
    pdu = framed(asked(1)) if plus else read(1, dbw(1, 0))
    size = len(pdu) // parts
    cuts = [pdu[at * size : (at + 1) * size if at < parts - 1 else len(pdu)] for at in range(parts)]
    for part in cuts[:-1]:
        talk.packet(CLIENT, build.dt(part, eot=False))
        talk.packet(CLIENT, EMPTY)
    frame = talk.packet(CLIENT, build.dt(cuts[-1]))
    talk.tell(framed(told(1)) if plus else words(1, 1))
    talk.close()
    assert [(one.outcome, one.request_frame, one.request_octets) for one in talk.transactions] == [
        ("answered", frame, pdu)
    ]
    assert set(talk.slugs()) <= {"s7plus.malformed"}  # its contents are nothing but a head


def test_a_last_part_that_is_a_message_by_itself_is_one_unless_the_whole_is_as_well() -> None:
    """Somebody left out an end; a write that holds the octets of a request is still a write."""
    lone = read(2, dbw(1, 0))
    for first, requests, slug in (
        (read(1, dbw(1, 0)), [1, 2], "cotp.unfinished_tsdu"),  # only its end mark was missing
        (b"what is this", [2], "cotp.unfinished_tsdu"),
        (build.pdu(build.JOB, 7, b"\x05\x01" + dbw(1, 0), bytes(4) + lone)[: -len(lone)], [7], ""),
    ):
        talk = opened()
        talk.packet(CLIENT, build.dt(first, eot=False))
        frame = talk.packet(CLIENT, build.dt(lone))
        talk.close()
        assert sorted(one.pdu_ref for one in talk.transactions) == requests
        found = [(one.detail, one.frames) for one in talk.findings if one.slug == "cotp.unfinished_tsdu"]
        assert found == ([(f"from {WHO[CLIENT]}: a complete PDU follows it", [frame])] if slug else [])
        octets = talk.pipeline.counters.octets
        assert octets.framed == octets.delivered


def test_a_message_behind_parts_that_are_too_long_is_one() -> None:
    """They are dropped, and all of them are counted."""
    talk = opened()
    for _ in range(66):
        talk.packet(CLIENT, build.dt(bytes(1000), eot=False))
    talk.ask(read(2, dbw(1, 0)))
    talk.close()
    assert [one.pdu_ref for one in talk.transactions] == [2]
    assert details(talk, "cotp.tsdu_too_long") == [f"from {WHO[CLIENT]}"]
    assert details(talk, "cotp.unfinished_tsdu") == [f"from {WHO[CLIENT]}: a complete PDU follows it"]


@each("how", ["end", "gap", "cut"])
def test_what_ends_a_message_in_parts_is_said(how: str) -> None:
    talk = opened()
    pdu = read(1, dbw(1, 0))
    talk.packet(CLIENT, build.dt(pdu[:9], eot=False))
    if how == "gap":
        talk.seq[CLIENT] += 20
        talk.ask(read(2, dbw(1, 0)))
        talk.packet(SERVER)
    elif how == "cut":
        talk.packet(CLIENT, build.dt(pdu[9:]), cut=10)
    else:
        talk.packet(CLIENT, flags=FIN | ACK)
    talk.silence(3 * SECOND)
    talk.finish()
    said = {"end": f"from {WHO[CLIENT]}", "gap": "bytes were lost", "cut": "the capture truncated one of its packets"}
    assert details(talk, "cotp.unfinished_tsdu") == [said[how]]
    assert ("stream.hole" in talk.slugs()) is (how == "gap")


@each("kept", range(4, 21))
def test_of_a_tpkt_that_the_capture_cut_a_whole_header_is_enough(kept: int) -> None:
    """Seven octets of TPKT and DT, ten of the PDU; of a part or another TPDU nothing is known."""
    request, plus = dt(read(1, dbw(1, 0))), dt(framed(asked(1)))
    for octets, known in (
        (request, True),
        (plus, True),
        (build.dt(read(1, dbw(1, 0)), eot=False), False),
        (dt(bytes(30)), False),
    ):
        talk = opened()
        before = tpdus(talk)["DT"]
        talk.packet(CLIENT, octets, cut=len(octets) - kept)
        talk.finish()
        counts = talk.pipeline.s7.cut_pdus + talk.pipeline.plus.cut_pdus
        assert counts == (known and kept >= 17), (kept, octets)
        assert tpdus(talk)["DT"] - before == counts


def test_a_tpkt_that_the_capture_cut_is_no_message_amid_another() -> None:
    for amid in (False, True):
        talk = opened()
        if amid:
            talk.packet(CLIENT, build.dt(b"what", eot=False))
        talk.packet(CLIENT, dt(read(1, dbw(1, 0))), cut=4)
        talk.finish()
        assert talk.pipeline.s7.cut_pdus == (not amid)


def test_what_is_kept_is_known_to_the_octet() -> None:
    """Of a TPKT that is begun, and of a message in parts."""
    talk = opened()
    (side,) = talk.pipeline.table.all_open()
    assert side.peer is not None
    of_iso = talk.pipeline.iso
    held = []
    for octets in (build.dt(b"0123456789", eot=False), b"\x03\x00\x00\x20\x02", build.dt(b"x")[:0]):
        if octets:
            talk.packet(CLIENT, octets)
        held.append((int(of_iso.held(side)), int(of_iso.held(side.peer))))
    assert held == [(10, 0), (15, 0), (15, 0)]
    talk.packet(SERVER, dt(framed(told(1), trailer=False)))
    assert of_iso.held(side.peer) == len(framed(told(1), trailer=False))


# ---- irregular headers ----------------------------------------------------------------------------------------------


def test_a_dt_with_a_longer_header_is_read_and_reported() -> None:
    talk = opened()
    pdu = read(1, dbw(1, 0))
    frame = talk.packet(CLIENT, build.tpkt(b"\x04\xf0\x80\xc0\x00" + pdu))
    talk.tell(words(1, 1))
    octets = talk.pipeline.counters.octets
    assert [(one.detail, one.frames) for one in talk.findings] == [("DT: length indicator 4, class 0 has 2", [frame])]
    assert talk.outcomes() == ["answered"]
    assert (octets.failed, octets.skipped) == (0, 0)


@each("count", [1, 2])
def test_what_is_left_out_of_an_irregular_dt_is_counted(count: int) -> None:
    talk = opened()
    for _ in range(count):
        talk.packet(CLIENT, build.tpkt(b"\x04\xf0\x80\xc0\x00what is this"))
    (side,) = talk.pipeline.table.all_open()
    assert side.assembler.dropped == count * len(b"what is this")
    assert len(details(talk, "cotp.malformed")) == count


@each("plus", [False, True])
def test_a_message_behind_a_malformed_header_names_the_connection(plus: bool) -> None:
    pdu = framed(asked(1)) if plus else read(1, dbw(1, 0))
    talk = begun()
    frame = talk.packet(CLIENT, build.tpkt(b"\x00\xf0\x80" + pdu))
    talk.close()
    name = "S7comm-plus" if plus else "S7comm"
    said = f"DT: cotp: length indicator at byte 0 is 0, expected 1 to 254; behind it {name}, {len(pdu)} bytes"
    assert [(one.detail, one.frames) for one in talk.findings if one.slug == "cotp.malformed"] == [(said, [frame])]
    (connection,) = talk.connections
    assert (connection.protocol, connection.behind) == ("s7comm_plus" if plus else "s7comm", 1)
    other = begun()
    other.packet(CLIENT, dt(b"\x01\x00\x01\x00\x61\x00"))
    other.packet(CLIENT, build.tpkt(b"\x00\xf0\x80" + pdu))
    other.close()
    assert other.connections[0].protocol == "mms"


# ---- numbered DTs and DTs that are too long -------------------------------------------------------------------------


@each("number", [1, 64, 127])
@each("side", [CLIENT, SERVER])
def test_numbers_of_dts_are_reported_once_for_each_side(side: int, number: int) -> None:
    for kind in (Talk, Looking):
        talk = opened(kind)
        for ref in range(3):
            talk.packet(CLIENT, build.dt(read(ref, dbw(1, 0)), number=number if side == CLIENT else 0))
            talk.packet(SERVER, build.dt(words(ref, 1), number=number if side == SERVER else 0))
        talk.close()
        assert details(talk, "cotp.tpdu_nr") == [f"TPDU number {number} from {WHO[side]}"]
        assert talk.outcomes() == ["answered"] * 3


@each("kind", [Talk, Looking])
def test_a_dt_may_be_as_long_as_negotiated(kind: type[Talk]) -> None:
    """1024 octets, header included, as the connect request of the talk asks for."""
    for size in (1021, 1022):
        talk = kind()
        talk.open(8, 8, 960)
        frame = talk.packet(CLIENT, dt(bytes(size)))
        found = [(one.detail, one.frames) for one in talk.findings if one.slug == "cotp.size_exceeded"]
        assert found == ([(f"{size + 3} bytes, 1024 negotiated", [frame])] if size > 1021 else [])


@each(("place", "told"), [(12, True), (1, True), (-1, True), (100, False)])
def test_a_request_in_several_tpdus_may_be_why_it_has_no_answer(place: int, told: bool) -> None:
    """Not one that was whole before an empty DT ended it."""
    talk = opened()
    for ref in (1, 2):
        pdu = read(ref, dbw(1, 0))
        talk.packet(CLIENT, build.dt(pdu[:place], eot=False) + build.dt(pdu[place:]))
        talk.wait(SECOND)
    talk.packet(SERVER, flags=RST, after_ns=2 * SECOND)
    talk.finish()
    assert ("cotp.fragments_unanswered" in talk.slugs()) is told


def test_octets_of_no_known_protocol_are_a_tpkt_again_only_where_a_segment_begins() -> None:
    """Behind stray octets a place inside a segment needs more evidence."""
    stray = b"\xff" * 20
    for pieces, found in (
        ([stray, dt(b"what is this")], 1),
        ([stray + dt(b"what is this")], 0),
        ([stray + dt(read(1, dbw(1, 0)))], 0),
        ([dt(read(1, dbw(1, 0))) + stray, dt(b"what is this")], 1),
    ):
        talk = opened()
        for octets in pieces:
            talk.packet(CLIENT, octets)
        talk.finish()
        assert tsdus(talk).get("unknown", 0) == found, pieces


@each("content", [b"what is this", framed(asked(1)), b"", b"\x32\x01", read(1, dbw(1, 0))])
def test_a_length_that_covers_other_tpkts_hides_none_of_them(content: bytes) -> None:
    hidden = dt(read(2, dbw(1, 0)), read(3, dbw(1, 0)))
    octets = dt(content)
    talk = opened()
    talk.packet(CLIENT, octets[:2] + (len(octets) + len(hidden)).to_bytes(2, "big") + octets[4:] + hidden)
    talk.tell(words(2, 1), words(3, 1))
    talk.close()
    assert [one.pdu_ref for one in talk.transactions if one.outcome == "answered"] == [2, 3]
    assert "tpkt.false_length" in talk.slugs()


@each("content", [b"what is this", framed(asked(1)), b"\x01\x00\x01\x00\x61\x00"])
def test_several_tpkts_of_any_protocol_in_one_segment_are_all_taken(content: bytes) -> None:
    talk = opened(Looking)
    assert isinstance(talk, Looking)
    talk.tpdus.clear()
    said = [dt(content), EMPTY, dt(read(2, dbw(1, 0))), dt(content), dt(read(3, dbw(1, 0))), EMPTY]
    for octets in (b"".join(said), b"".join(said)):
        talk.packet(CLIENT, octets)
    assert [octets for _, octets in talk.tpdus] == said * 2
    plain = opened()
    plain.packet(CLIENT, b"".join(said))
    plain.packet(CLIENT, b"".join(said))
    assert heard(talk) == heard(plain)
