"""A TPKT with too large a length, and a DT without its end mark, are whole when they come; only the next one shows it."""

from __future__ import annotations

import pytest

from tests import build
from tests.engine.transactions.talk import CLIENT, SECOND, SERVER, Talk, dbw, dt, read, words


def too_long(pdu: bytes, by: int = 1) -> bytes:
    """A TPKT whose length says more than there is."""
    octets = dt(pdu)
    return octets[:2] + (len(octets) + by).to_bytes(2, "big") + octets[4:]


def without_end(pdu: bytes) -> bytes:
    """A DT that does not end its TSDU."""
    return build.dt(pdu, eot=False)


FAULTS = {"too long": too_long, "huge": lambda pdu: too_long(pdu, 0x4000), "no end": without_end}


@pytest.fixture
def talk() -> Talk:
    talk = Talk()
    talk.open()
    return talk


def values(talk: Talk) -> list[tuple[str, object]]:
    results = [one.s7_results[0] for one in talk.transactions]
    return [(one.item.address, one.value) for one in results if one.item is not None]


@pytest.mark.parametrize("pause_ns", [0, 2 * SECOND])
@pytest.mark.parametrize("pdu_ref", [0, 1])
@pytest.mark.parametrize("fault", FAULTS)
def test_a_request(talk: Talk, fault: str, pdu_ref: int, pause_ns: int) -> None:
    pairs = []
    for number in range(4):
        request = read(number * pdu_ref, dbw(1, 2 * number))
        asked = talk.packet(CLIENT, FAULTS[fault](request) if number == 1 else dt(request))
        pairs.append((asked, talk.tell(words(number * pdu_ref, number))))
        talk.wait(pause_ns)
    talk.close()
    assert talk.pairs() == pairs
    assert values(talk) == [(f"DB1.DBW{2 * number}", number) for number in range(4)]
    assert all(one._flags == 0 for one in talk.transactions)
    assert talk.slugs() == ["cotp.unfinished_tsdu" if fault == "no end" else "tpkt.false_length"]


@pytest.mark.parametrize("pdu_ref", [0, 1])
@pytest.mark.parametrize("fault", FAULTS)
def test_an_answer(talk: Talk, fault: str, pdu_ref: int) -> None:
    pairs = []
    for number in range(4):
        asked = talk.ask(read(number * pdu_ref, dbw(1, 2 * number)))
        answer = words(number * pdu_ref, number)
        pairs.append((asked, talk.packet(SERVER, FAULTS[fault](answer) if number == 1 else dt(answer))))
    talk.close()
    assert talk.pairs() == pairs
    assert values(talk) == [(f"DB1.DBW{2 * number}", number) for number in range(4)]
    assert talk.slugs() == ["cotp.unfinished_tsdu" if fault == "no end" else "tpkt.false_length"]


def test_what_comes_in_pieces_is_dated_by_the_last(talk: Talk) -> None:
    """Nothing of this is wrong: the request is whole with the packet that brings its last byte."""
    octets = dt(read(1, dbw(1, 0)))
    talk.packet(CLIENT, octets[:10])
    asked = talk.packet(CLIENT, octets[10:])
    answered = talk.tell(words(1, 7))
    octets = build.dt(read(2, dbw(1, 2))[:9], eot=False) + build.dt(read(2, dbw(1, 2))[9:])
    talk.packet(CLIENT, octets[:20])
    later = talk.packet(CLIENT, octets[20:])
    told = talk.tell(words(2, 8))
    talk.close()
    assert talk.pairs() == [(asked, answered), (later, told)]


def test_an_answer_does_not_wait_for_ever_for_what_is_unfinished(talk: Talk) -> None:
    octets = dt(read(1, dbw(1, 0)))
    talk.packet(CLIENT, octets[:10])
    orphan = talk.tell(words(5, 7))
    talk.wait(5 * SECOND)
    talk.packet(SERVER)
    assert talk.pairs() == []
    talk.wait(5 * SECOND)
    talk.packet(SERVER)
    assert talk.pairs() == [(0, orphan)]
