"""S7comm-plus: the numbers that PDUs count with, PDUs behind malformed headers, and what an observer gets of them."""

from __future__ import annotations

from typing import Final

import pytest

from dissect.engine.transactions.side import Side
from tests import build
from tests.cases import each
from tests.engine.test_plus import begun
from tests.engine.transactions.talk import (
    CLIENT,
    MS,
    SECOND,
    SERVER,
    START_NS,
    Talk,
    dbw,
    dt,
    read,
    words,
)
from tests.protocols.s7plus.pdus import (
    CREATE_OBJECT,
    GET_MULTI,
    INIT_SSL,
    KEEP_ALIVE,
    asked,
    event,
    framed,
    notified,
    told,
)

REPLAY: Final = "security.replay"
LOST: Final = "s7plus.notifications_lost"
NAMES: Final = {GET_MULTI: "GetMultiVariables", CREATE_OBJECT: "CreateObject", INIT_SSL: "InitSSL"}


class Seen(Talk):
    """Writes down the PDUs that it gets."""

    def __init__(self) -> None:
        super().__init__()
        self.wants_pdus = True
        self.seen: list[tuple[int, int, bytes, bool]] = []

    def plus_pdu(self, frame: int, time_ns: int, side: Side, octets: bytes, cut: bool) -> None:
        assert time_ns == START_NS + frame * MS  # the time of its own packet
        self.seen.append((frame, int(side.index), octets, cut))

    def begin(self) -> Seen:
        self.hello()
        self.connect()
        return self


def details(talk: Talk, slug: str) -> list[str]:
    return [one.detail for one in talk.findings if one.slug == slug]


def behind(pdu: bytes) -> bytes:
    """A PDU behind the header of a DT whose length indicator is impossible."""
    return build.tpkt(b"\x00\xf0\x80" + pdu)


# ---- numbers of requests --------------------------------------------------------------------------------------------


@each(
    ("first", "second", "again"),
    [
        (5, 6, False),
        (5, 900, False),  # lost requests leave gaps
        (5, 5, True),
        (5, 4, True),
        (900, 2, True),
        (0xFFFF, 0, False),  # the number after the last one
        (0, 1, False),
        (0, 0, True),
        (0, 0x9000, True),
        (0xFFFE, 1, False),
        (5, 5 + 0x7FFF, False),
        (5, 5 + 0x8000, True),  # half of all numbers ahead is as far behind
        (5, 5 + 0x8001, True),
    ],
)
def test_a_request_whose_number_does_not_go_up_is_reported(first: int, second: int, again: bool) -> None:
    talk = begun()
    talk.ask(framed(asked(first)))
    frame = talk.ask(framed(asked(second)))
    said = f"10.0.0.1:50000 to 10.0.0.2:102: GetMultiVariables with sequence number {second} follows {first}"
    assert details(talk, REPLAY) == ([said] if again else [])
    assert [(one.frames, one.connection) for one in talk.findings if one.slug == REPLAY] == [([frame], 1)] * again


@each("function", [GET_MULTI, CREATE_OBJECT, INIT_SSL])
@each("number", [0, 1, 2])
def test_a_session_that_begins_counts_from_one_again(function: int, number: int) -> None:
    talk = begun()
    talk.ask(framed(asked(900)))
    talk.ask(framed(asked(number, function)))
    begins = function != GET_MULTI and number <= 1
    said = f"10.0.0.1:50000 to 10.0.0.2:102: {NAMES[function]} with sequence number {number} follows 900"
    assert details(talk, REPLAY) == ([] if begins else [said])
    talk.ask(framed(asked(number + 1)))  # counted from there on
    assert len(details(talk, REPLAY)) == (not begins)


def test_each_side_counts_its_own_requests() -> None:
    talk = begun()
    for number in (7, 8):
        talk.ask(framed(asked(number)))
        talk.tell(framed(asked(number - 5)))
    assert details(talk, REPLAY) == []
    talk.tell(framed(asked(3)))
    assert details(talk, REPLAY) == [
        "10.0.0.2:102 to 10.0.0.1:50000: GetMultiVariables with sequence number 3 follows 3"
    ]


# ---- numbers of notifications ---------------------------------------------------------------------------------------


def one_octet(number: int, subscription: int = 0x70000E51) -> bytes:
    """A notification whose number has seven bits or fewer, or 14 in two octets."""
    head = notified(0, subscription)[:-3]
    return head + (bytes((number,)) if number < 0x80 else bytes((0x80 | number >> 7, number & 0x7F))) + b"\x01\x00"


@each(
    ("first", "second", "lost"),
    [
        (5, 6, False),
        (5, 5, True),
        (5, 7, True),
        (5, 4, True),
        (5, 1, False),
        (1, 1, False),
        (255, 0, True),
        (255, 256, False),
    ],
)
def test_a_notification_that_does_not_count_up_by_one_follows_lost_ones(first: int, second: int, lost: bool) -> None:
    talk = begun()
    talk.tell(framed(one_octet(first)))
    frame = talk.tell(framed(one_octet(second)))
    said = f"10.0.0.2:102, subscription 0x70000e51: number {second} follows {first}"
    assert details(talk, LOST) == ([said] if lost else [])
    assert [one.frames for one in talk.findings if one.slug == LOST] == [[frame]] * lost


def short(number: int, subscription: int) -> bytes:
    """A notification of an old S7-1200: its number is the octet that counts credit elsewhere."""
    octets = bytearray(notified(1, subscription))
    octets[11] = number
    return bytes(octets)


@each("subscription", [0x12, 0x6FFFFFFF])
@each(
    ("first", "second", "lost"),
    [(5, 6, False), (5, 5, True), (5, 7, True), (255, 0, False), (254, 0, True), (255, 1, False), (0, 255, True)],
)
def test_old_cpus_count_notifications_with_one_octet(subscription: int, first: int, second: int, lost: bool) -> None:
    talk = begun()
    talk.tell(framed(short(first, subscription)))
    talk.tell(framed(short(second, subscription)))
    said = f"10.0.0.2:102, subscription 0x{subscription:08x}: number {second} follows {first}"
    assert details(talk, LOST) == ([said] if lost else [])


def test_all_subscriptions_of_a_connection_count_together() -> None:
    talk = begun()
    for number, subscription in ((5, 0x70000E51), (6, 0x70000E52), (7, 0x70000E51)):
        talk.tell(framed(one_octet(number, subscription)))
    assert details(talk, LOST) == []


def test_notifications_of_version_1_do_not_count() -> None:
    talk = begun()
    for number in (5, 9, 2):
        talk.tell(framed(one_octet(number), 1))
    assert details(talk, LOST) == []


# ---- who asks, and what is paired -----------------------------------------------------------------------------------


@each("pdu", [(CLIENT, asked(1)), (SERVER, told(1)), (SERVER, notified()), (SERVER, told(1, opcode=2))])
def test_the_first_pdu_shows_who_is_the_client(pdu: tuple[int, bytes]) -> None:
    """On a port that does not tell, met in its midst."""
    for swapped in (False, True):
        talk = Talk(4000, 4102)
        side = pdu[0] ^ swapped
        talk.packet(side, dt(framed(pdu[1], 3)))
        talk.finish()
        (connection,) = talk.connections
        assert connection.client_known
        assert connection.client.port == (4102 if swapped else 4000)


@each("version", [1, 2, 3])
def test_the_other_form_of_a_response_answers_only_where_something_waits(version: int) -> None:
    talk = begun()
    talk.ask(framed(asked(1), version))
    talk.tell(framed(told(1, opcode=2), version))
    talk.tell(framed(told(2, opcode=2), version))
    talk.close()
    assert talk.outcomes() == ["answered", "unsolicited" if version == 3 else "orphan_answer"]


def test_a_request_of_version_3_that_wants_no_response_waits_for_none() -> None:
    for version, reason in ((2, "answered"), (3, "orphan_answer")):
        talk = begun()
        talk.ask(framed(asked(1, flags=0x74), version))
        talk.tell(framed(told(1), version))
        talk.close()
        assert reason in talk.outcomes()


def test_numbers_of_s7comm_plus_are_no_references_of_s7comm() -> None:
    """A number that is used twice, or by a request of the other protocol, is not shared."""
    talk = begun()
    talk.ask(framed(asked(1)), framed(asked(1)))
    talk.ask(read(1, dbw(1, 0)))
    assert "session.shared_reference" not in talk.slugs()


def test_a_name_that_something_unknown_gave_the_connection_goes() -> None:
    talk = begun()
    talk.packet(CLIENT, dt(b"what is this"))
    talk.ask(framed(asked(1)))
    talk.close()
    assert (talk.connections[0].protocol, talk.connections[0].identified_by) == ("s7comm_plus", "")


def test_a_name_of_another_protocol_stays() -> None:
    talk = begun()
    talk.packet(CLIENT, dt(b"\x01\x00\x01\x00\x61\x00"))
    talk.ask(framed(asked(1)))
    talk.close()
    assert (talk.connections[0].protocol, talk.connections[0].identified_by) == ("mms", "DATA TRANSFER")


def test_damaged_pdus_say_what_they_are_and_who_sent_them() -> None:
    talk = begun()
    for number in (1, 2):
        talk.ask(framed(asked(number)) + b"more")
    talk.tell(framed(told(1)) + b"more")
    talk.tell(framed(b"\x44what"))
    talk.tell(framed(b"\x45what"))
    malformed = details(talk, "s7.malformed")
    assert [said.split(": ")[0] for said in malformed] == [
        "S7comm-plus Request from 10.0.0.1:50000",
        "S7comm-plus Request from 10.0.0.1:50000",
        "S7comm-plus Response from 10.0.0.2:102",
    ]
    assert len(details(talk, "s7plus.unknown_kind")) == 1  # once for a connection
    assert talk.pipeline.finding_counts["s7.malformed"] == 3


# ---- PDUs in several frames -----------------------------------------------------------------------------------------


def test_a_pdu_that_another_one_interrupts_is_reported() -> None:
    talk = Seen().begin()
    first, second = framed(told(1), trailer=False), framed(told(2))
    talk.packet(SERVER, dt(first))
    frame = talk.packet(SERVER, dt(second))
    assert [(one.detail, one.frames) for one in talk.findings if one.slug == "s7.malformed"] == [
        ("S7comm-plus PDU from 10.0.0.2:102: a new one begins before its end", [frame])
    ]
    assert [(side, octets, cut) for _, side, octets, cut in talk.seen] == [
        (SERVER, first, True), (SERVER, second, False),
    ]  # fmt: skip
    plus = talk.pipeline.plus
    assert (plus.pdus, plus.cut_pdus) == (2, 1)


def test_what_is_kept_of_an_unfinished_pdu_is_known() -> None:
    talk = begun()
    frames = [framed(told(1, body=bytes(50)), trailer=False), framed(bytes(70), trailer=False)]
    (side,) = talk.pipeline.table.all_open()
    assert side.peer is not None
    held = []
    for octets in [*frames, framed(b"end")]:
        talk.packet(SERVER, dt(octets))
        held.append((int(talk.pipeline.plus.held(side)), int(talk.pipeline.plus.held(side.peer))))
    assert held == [(0, len(frames[0])), (0, len(frames[0]) + len(frames[1])), (0, 0)]


@pytest.mark.parametrize("version", [2, 3])
def test_a_pdu_in_frames_is_one_for_an_observer(version: int) -> None:
    talk = Seen().begin()
    frames = [framed(told(1, body=bytes(50)), version, trailer=False), framed(b"end", version)]
    first, last = (talk.packet(SERVER, dt(octets)) for octets in frames)
    assert last == first + 1
    talk.packet(CLIENT, dt(KEEP_ALIVE))
    assert talk.seen == [(last, SERVER, b"".join(frames), False), (last + 1, CLIENT, KEEP_ALIVE, False)]


def test_a_frame_that_the_capture_cut_ends_its_pdu() -> None:
    talk = Seen().begin()
    octets = framed(told(1, body=bytes(100)))
    talk.packet(SERVER, dt(framed(told(2), trailer=False)))
    frame = talk.packet(SERVER, dt(octets), cut=40)
    assert talk.seen[-1] == (frame, SERVER, octets[:-40], True)
    assert [cut for *_, cut in talk.seen] == [True, True]
    assert talk.pipeline.plus.cut_pdus == 2


# ---- behind malformed headers ---------------------------------------------------------------------------------------


@each(
    ("pdu", "cut"),
    [
        (framed(asked(1)), False),
        (framed(asked(1), trailer=False), True),  # one of several frames, perhaps
        (framed(asked(1), 3), False),
        (framed(asked(1), 3, trailer=False), True),
    ],
)
def test_a_request_behind_a_malformed_header_is_counted_apart(pdu: bytes, cut: bool) -> None:
    talk = Seen().begin()
    frame = talk.packet(CLIENT, behind(pdu))
    assert talk.seen == [(frame, CLIENT, pdu, cut)]
    talk.close()
    assert [(one.outcome, one.reason, one.is_behind, one.request_frame) for one in talk.transactions] == [
        ("behind_malformed", "malformed_header", True, frame)
    ]
    plus = talk.pipeline.plus
    assert (plus.behind_malformed, plus.pdus, plus.unpaired, plus.cut_pdus) == (1, 0, 0, 0)
    assert (talk.connections[0].protocol, talk.connections[0].behind, talk.connections[0].pdus) == ("s7comm_plus", 1, 0)
    assert details(talk, "cotp.malformed") == [
        f"DT: cotp: length indicator at byte 0 is 0, expected 1 to 254; behind it S7comm-plus, {len(pdu)} bytes"
    ]


@each("pdu", [KEEP_ALIVE, event(100), framed(b"rest")])
def test_what_cannot_be_paired_behind_a_malformed_header_is_counted(pdu: bytes) -> None:
    talk = Seen().begin()
    frame = talk.packet(CLIENT, behind(pdu))
    talk.close()
    assert talk.transactions == []
    plus = talk.pipeline.plus
    assert (plus.behind_malformed, plus.pdus, plus.unpaired) == (1, 0, 1)
    assert talk.seen == [(frame, CLIENT, pdu, False)]
    # The section names these PDUs only where there are some.
    assert list(plus.describe()["s7plus"])[:2] == ["pdus", "behind_malformed"]  # type: ignore[call-overload]


def test_an_answer_behind_a_malformed_header_waits_for_a_better_one() -> None:
    talk = begun()
    request = talk.ask(framed(asked(1)))
    aside = talk.packet(SERVER, behind(framed(told(1))))
    assert talk.transactions == []
    answer = talk.tell(framed(told(1)))
    talk.close()
    assert sorted(talk.pairs()) == [(0, aside), (request, answer)]
    talk = begun()
    request = talk.ask(framed(asked(1)))
    aside = talk.packet(SERVER, behind(framed(told(1))))
    talk.close()
    assert [(one.outcome, one.is_behind) for one in talk.transactions] == [("answered", True)]
    assert talk.pairs() == [(request, aside)]


def test_a_notification_behind_a_malformed_header_stands_alone() -> None:
    talk = begun()
    aside = talk.packet(SERVER, behind(framed(notified(5))))
    talk.tell(framed(notified(9)))
    talk.close()
    assert talk.pairs() == [(0, aside), (0, aside + 1)]
    assert [one.outcome for one in talk.transactions] == ["behind_malformed", "unsolicited"]
    assert details(talk, LOST) == []  # its number counts for nothing


# ---- the section ----------------------------------------------------------------------------------------------------


def test_the_section_counts_by_version_opcode_and_function() -> None:
    talk = begun()
    assert talk.pipeline.plus.counted() == []
    functions = (GET_MULTI, 0x0480, 0x067F, 0x0680, 0x047F)
    for number, function in enumerate(functions, 1):
        talk.ask(framed(asked(number, function)))
    talk.tell(framed(told(1), 1), framed(notified(), 3), KEEP_ALIVE, event(1))
    talk.packet(SERVER, dt(framed(told(2, 0x0480))), cut=6)
    talk.close()
    assert talk.pipeline.plus.counted() == [(10, "S7comm-plus PDU")]
    assert talk.pipeline.plus.describe() == {
        "s7plus": {
            "pdus": 10,
            "cut": 1,
            "unpaired": 2,
            "versions": {"0x01": 1, "0x02": 6, "0x03": 1, "0xfe": 1, "0xff": 1},
            "opcodes": {"0x31": 5, "0x32": 2, "0x33": 1},
            "functions": {"0x047f": 1, "0x0480": 2, "0x054c": 2, "0x067f": 1, "0x0680": 1},
        }
    }


def test_a_connection_on_another_port_is_reported_with_its_first_pdu() -> None:
    talk = Talk(server_port=2000)
    talk.hello()
    talk.connect()
    frame = talk.ask(framed(asked(1)))
    talk.ask(framed(asked(2)), after_ns=SECOND)
    assert [(one.slug, one.frames) for one in talk.findings if one.slug == "session.unusual_port"] == [
        ("session.unusual_port", [frame])
    ]
    assert talk.now_ns % MS == 0


def test_a_pdu_of_s7comm_plus_says_nothing_about_pairs_of_others() -> None:
    """Whole or cut, on another connection: behind a gap, pairs are as certain as without it."""
    found = []
    for pdu, cut in ((b"", 0), (framed(asked(1)), 0), (framed(asked(1, body=bytes(50))), 20)):
        talk = Talk()
        talk.open(8, 8)
        other = Talk(client_port=50001, beside=talk)
        other.hello()
        other.connect()
        talk.lose(CLIENT, read(7, dbw(1, 0)))
        talk.lose(SERVER, words(7, 1))
        if pdu:
            other.packet(CLIENT, dt(pdu), cut=cut)
        for ref in range(8, 14):
            talk.ask(read(ref, dbw(1, 0)))
            talk.tell(words(ref, 1))
            talk.wait(SECOND)
        talk.finish()
        found.append([one.certainty for one in talk.transactions if not one.is_plus])
    assert found[0][-1] == "sure"
    assert found == found[:1] * 3
