"""An empty DT that acknowledges a request before its answer: a note for each connection, and what a slow answer says of it."""

from __future__ import annotations

import pytest

from dissect.engine.transactions.connection import MAX_EARLY
from tests import build
from tests.cases import each
from tests.engine.transactions.talk import CLIENT, MS, SECOND, SERVER, Talk, dbw, dt, read, words

EMPTY = build.dt(b"", eot=False)
SLUG = "cotp.empty_dt"


class Looking(Talk):
    """Asks for TPDUs, which then take the general road."""

    def __init__(self) -> None:
        super().__init__()
        self.wants_tpdus = True
        self.tpdus: list[bytes] = []

    def tpdu(self, frame: int, time_ns: int, side: object, octets: bytes) -> None:
        self.tpdus.append(octets)


def notes(talk: Talk) -> list[tuple[list[int], str]]:
    return [(list(one.frames), one.detail) for one in talk.findings if one.slug == SLUG]


@pytest.mark.parametrize("kind", [Talk, Looking])
def test_a_server_that_acknowledges_each_request_is_told_once(kind: type[Talk]) -> None:
    talk = kind()
    talk.open()
    frames = []
    for ref in range(1, 5):
        frames.append(talk.ask(read(ref, dbw(1, 0))))
        talk.packet(SERVER, EMPTY)
        talk.tell(words(ref, ref))
    talk.close()
    assert talk.outcomes() == ["answered"] * 4
    assert notes(talk) == [([frames[0], frames[0] + 1], "from 10.0.0.2:102, 1.00 ms after Read Var")]
    assert talk.slugs() == [SLUG]


#: How an empty DT and the answer may lie in segments.
CUTS = ("alone", "with the answer", "octet by octet", "with the next request")


@each(("how", "kind"), [(how, kind) for how in CUTS for kind in (Talk, Looking)])
def test_wherever_it_lies_in_segments(how: str, kind: type[Talk]) -> None:
    talk = kind()
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    octets = EMPTY + dt(words(1, 7))
    if how == "alone":
        talk.packet(SERVER, EMPTY)
        talk.packet(SERVER, octets[7:])
    elif how == "octet by octet":
        for at in range(len(octets)):
            talk.packet(SERVER, octets[at : at + 1])
    else:
        talk.packet(SERVER, octets)
    if how == "with the next request":
        talk.packet(CLIENT, EMPTY + dt(read(2, dbw(1, 0))) + EMPTY)
        talk.tell(words(2, 7))
    talk.close()
    assert talk.slugs() == [SLUG]
    assert set(talk.outcomes()) == {"answered"}


@pytest.mark.parametrize("kind", [Talk, Looking])
def test_other_empty_dts_are_everyday(kind: type[Talk]) -> None:
    """Behind an answer, from either side, and from the client itself while its request is open; a TSDU without data, too."""
    talk = kind()
    talk.open()
    for ref in range(1, 4):
        talk.packet(CLIENT, EMPTY)
        talk.packet(SERVER, EMPTY)
        talk.ask(read(ref, dbw(1, 0)))
        talk.packet(CLIENT, EMPTY)
        talk.packet(SERVER, build.dt(b""))
        talk.tell(words(ref, 1))
        talk.packet(CLIENT, EMPTY)
    talk.close()
    assert talk.slugs() == []
    assert talk.outcomes() == ["answered"] * 3


@pytest.mark.parametrize("kind", [Talk, Looking])
def test_one_between_the_parts_of_an_answer_belongs_to_it(kind: type[Talk]) -> None:
    talk = kind()
    talk.open()
    answer = words(1, 7)
    talk.ask(read(1, dbw(1, 0)))
    for piece in (build.dt(answer[:9], eot=False), EMPTY, build.dt(answer[9:])):
        talk.packet(SERVER, piece)
    talk.close()
    assert talk.slugs() == []
    assert talk.outcomes() == ["answered"]


def slow(talk: Talk) -> list[str]:
    return [one.detail for one in talk.findings if one.slug == "transaction.slow"]


@pytest.mark.parametrize("kind", [Talk, Looking])
def test_a_slow_answer_says_when_it_was_acknowledged(kind: type[Talk]) -> None:
    talk = kind()
    talk.open()
    frame = 0
    for ref in (1, 2):
        talk.ask(read(ref, dbw(1, 0)))
        if ref == 2:
            talk.packet(SERVER, EMPTY, after_ns=2 * MS)
            frame = talk.packet(SERVER, EMPTY, after_ns=40 * MS)
        talk.tell(words(ref, 1), after_ns=1500 * MS)
    talk.ask(read(3, dbw(1, 0)))
    talk.packet(CLIENT, EMPTY)
    talk.tell(words(3, 1), after_ns=1500 * MS)
    talk.packet(SERVER, EMPTY)
    talk.close()
    first, second, third = slow(talk)
    assert first.endswith("1.50 s, the limit is 1.00 s")
    assert second.endswith(
        f"1.54 s, the limit is 1.00 s; acknowledged after 2.00 ms by an empty DT (packet {frame - 1})"
    )
    assert third.endswith("1.50 s, the limit is 1.00 s")


def test_each_of_several_requests_has_its_own() -> None:
    talk = Talk()
    talk.open(2, 2)
    talk.ask(read(1, dbw(1, 0)))
    first = talk.packet(SERVER, EMPTY, after_ns=3 * MS)
    talk.ask(read(2, dbw(1, 1)), after_ns=100 * MS)
    second = talk.packet(SERVER, EMPTY, after_ns=5 * MS)
    talk.tell(words(1, 1), after_ns=2 * SECOND)
    talk.tell(words(2, 1), after_ns=MS)
    talk.close()
    assert [detail.partition("; ")[2] for detail in slow(talk)] == [
        f"acknowledged after 3.00 ms by an empty DT (packet {first})",
        f"acknowledged after 5.00 ms by an empty DT (packet {second})",
    ]


def test_what_is_remembered_is_bounded() -> None:
    talk = Talk()
    talk.open()
    for ref in range(1, 4 * MAX_EARLY):
        talk.ask(read(ref, dbw(1, 0)))
        talk.packet(SERVER, EMPTY)
        talk.tell(words(ref, 1))
    talk.ask(read(900, dbw(1, 0)))
    frame = 0
    for _ in range(3 * MAX_EARLY):
        frame = talk.packet(SERVER, EMPTY)
    assert len([one for one in range(frame + 1) if talk_has(talk, one)]) <= MAX_EARLY
    talk.tell(words(900, 1), after_ns=2 * SECOND)
    (detail,) = slow(talk)
    assert detail.endswith(f"(packet {frame + 1 - MAX_EARLY})")


def talk_has(talk: Talk, frame: int) -> bool:
    """Whether an empty DT in packet ``frame`` is remembered."""
    connection = talk.transactions[0].connection
    return connection.traits.early_ack(SERVER, frame - 1, frame + 1) is not None
