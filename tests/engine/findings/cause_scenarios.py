"""Conversations in which a finding explains another one, each with a counterpart in which the same finding has no cause."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from dissect.engine.findings.cause_tables import CAUSES, REQUEST
from tests import build
from tests.engine.findings.registry import Scenario, silent, speaks
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
    ack,
    ack_data,
    dbw,
    dt,
    good,
    granted,
    item,
    read,
    setup,
    tpkt,
    words,
    write,
    written,
)

Pair = tuple[str, str]

#: By cause and consequence: the conversation in which the cause applies, and the one in which it does not.
EXPLAINED: Final[dict[Pair, Scenario]] = {}
UNEXPLAINED: Final[dict[Pair, Scenario]] = {}


def explains(cause: str, *consequences: str) -> Callable[[Scenario], Scenario]:
    def keep(scenario: Scenario) -> Scenario:
        for slug in consequences:
            assert (cause, slug) not in EXPLAINED
            EXPLAINED[cause, slug] = scenario
        return scenario

    return keep


def explains_not(cause: str, *consequences: str) -> Callable[[Scenario], Scenario]:
    def keep(scenario: Scenario) -> Scenario:
        for slug in consequences:
            assert (cause, slug) not in UNEXPLAINED
            UNEXPLAINED[cause, slug] = scenario
        return scenario

    return keep


MB0: Final = item(0x83, 0, 0, 2)
MB2: Final = item(0x83, 0, 2 * 8, 2)
SOUND: Final = read(9, dbw(1, 0))
SOUND_WRITE: Final = write(9, [MB0], written(4, b"\1"))


def connect(tpdu: int) -> tuple[bytes, bytes]:
    """CR and CC with a TPDU size of 2 to the power of ``tpdu``."""
    return CONNECT[:-1] + bytes((tpdu,)), CONFIRM[:-1] + bytes((tpdu,))


def connected(talk: Talk) -> None:
    """The handshakes of TCP and COTP."""
    talk.hello()
    talk.connect()


def begin(talk: Talk, size: int = 240, tpdu: int = 10, jobs: int = 3) -> None:
    """Everything up to the setup."""
    talk.hello()
    asked, confirmed = connect(tpdu)
    talk.packet(CLIENT, asked)
    talk.packet(SERVER, confirmed)
    talk.ask(setup(0, jobs, jobs, size))
    talk.tell(granted(0, jobs, jobs, size))


# ---- requests with a fault ------------------------------------------------------------------------------------------

#: By cause: the beginning of the conversation, and the faulty request, whose reference is 1; a read, or a write.
FAULTS: Final[dict[str, tuple[Callable[[Talk], None], bytes]]] = {
    "s7.malformed": (begin, write(1, [MB0, MB2], written(4, b"\1") + written(4, b"\2"))),
    "transaction.write_size": (begin, write(1, [dbw(1, 0)], written(4, b"\1"))),
    "transaction.bit_count": (begin, write(1, [item(0x83, 0, 0, 1, 2)], written(3, b"\1\1"))),
    "session.read_too_long": (begin, read(1, item(0x84, 1, 0, 2, 300))),
    "session.pdu_too_long": (begin, write(1, [item(0x83, 0, 0, 2, 230)], written(4, bytes(230)))),
    "cotp.size_exceeded": (
        lambda talk: begin(talk, tpdu=7),
        write(1, [item(0x83, 0, 0, 2, 120)], written(4, bytes(120))),
    ),
    "session.data_before_setup": (
        connected,
        read(1, dbw(1, 0)),
    ),
}


def refuse(talk: Talk, request: bytes, reference: int) -> None:
    """Refuse it as a whole."""
    talk.ask(request)
    talk.tell(ack(reference, 0x8104))


def refuse_items(talk: Talk, request: bytes, reference: int) -> None:
    """Refuse its items; for a write the last one."""
    talk.ask(request)
    function, count = request[10], request[11]
    code = b"\6" if request[15] == 1 else b"\7"
    codes = code.rjust(count, b"\xff") if function == 5 else (code + bytes(3)) * count
    talk.tell(ack_data(reference, bytes((function, count)), codes))


def reset(talk: Talk, request: bytes, reference: int) -> None:
    """Reset the connection while it is open together with another one."""
    talk.ask(request)
    talk.ask(read(20, dbw(3, 0)))
    talk.packet(SERVER, flags=RST, after_ns=5 * SECOND)


#: What a server does with a request, by the consequence.
DEEDS: Final[dict[str, Callable[[Talk, bytes, int], None]]] = {
    "transaction.refused": refuse,
    "security.protected": refuse,
    "security.write_refused": refuse,
    "transaction.item_error": refuse_items,
    "transaction.unanswered": reset,
    "session.cut": reset,
}


def deed(cause: str, slug: str) -> Callable[[Talk, bytes, int], None]:
    return refuse_items if cause == "transaction.bit_count" else DEEDS[slug]


def at_fault(cause: str, slug: str) -> Scenario:
    def scenario(talk: Talk) -> None:
        opened, request = FAULTS[cause]
        opened(talk)
        deed(cause, slug)(talk, request, 1)
        talk.finish()

    return scenario


def another(cause: str, slug: str) -> Scenario:
    """The faulty request was refused and is over; then the same happens to a sound one."""

    def scenario(talk: Talk) -> None:
        opened, request = FAULTS[cause]
        opened(talk)
        refuse(talk, request, 1)
        if cause == "session.data_before_setup":
            talk.ask(setup(0, 3, 3))
            talk.tell(granted(0, 3, 3))
        sound = SOUND_WRITE if slug == "security.write_refused" else SOUND
        DEEDS[slug](talk, sound, 9)
        talk.finish()

    return scenario


for _row in CAUSES:
    if _row.scope == REQUEST:
        for _slug in _row.consequences:
            explains(_row.slug, _slug)(at_fault(_row.slug, _slug))
            explains_not(_row.slug, _slug)(another(_row.slug, _slug))


@speaks("transaction.bit_count")
def several_bits(talk: Talk) -> None:
    begin(talk)
    refuse_items(talk, read(1, item(0x84, 200, 16 * 8, 1, 4)), 1)


@silent("transaction.bit_count")
def one_bit(talk: Talk) -> None:
    """A single bit that is refused, several bits refused for another reason, and several bits that are accepted."""
    begin(talk)
    refuse_items(talk, read(1, item(0x84, 200, 16 * 8, 1)), 1)
    bits = item(0x84, 200, 16 * 8, 1, 4)
    talk.ask(read(2, bits))
    talk.tell(ack_data(2, b"\4\1", b"\x0a\0\0\0"))
    talk.ask(read(3, bits))
    talk.tell(ack_data(3, b"\4\1", good(3, bytes(4))))


# ---- what shows itself in what stays unanswered ---------------------------------------------------------------------


@speaks("session.tpdu_too_small")
@explains("session.tpdu_too_small", "transaction.unanswered", "session.cut")
def too_large(talk: Talk) -> None:
    begin(talk, 960, 9)
    talk.ask(read(1, item(0x84, 1, 0, 2, 600)))
    talk.ask(read(2, dbw(1, 0)))
    talk.packet(SERVER, flags=RST)
    talk.finish()


@silent("session.tpdu_too_small")
@explains_not("session.tpdu_too_small", "transaction.unanswered", "session.cut")
def small_enough(talk: Talk) -> None:
    """509 octets of PDU are what a TPDU of 512 can carry."""
    begin(talk, 960, 9)
    talk.ask(read(1, item(0x84, 1, 0, 2, 491)))
    talk.ask(read(2, dbw(1, 0)))
    talk.packet(SERVER, flags=RST)
    talk.finish()


def in_fragments(talk: Talk, pdu: bytes) -> None:
    """One message in two TPDUs."""
    talk.packet(CLIENT, build.dt(pdu[:12], eot=False) + build.dt(pdu[12:]))


@speaks("cotp.fragments_unanswered")
@explains("cotp.fragments_unanswered", "transaction.unanswered", "session.cut", "session.too_many_jobs")
def never_joined(talk: Talk) -> None:
    begin(talk, jobs=1)
    for reference in (1, 2):
        in_fragments(talk, read(reference, dbw(1, 0), dbw(2, 0)))
        talk.wait(SECOND)
    talk.packet(SERVER, flags=RST, after_ns=2 * SECOND)
    talk.finish()


@silent("cotp.fragments_unanswered")
@explains_not("cotp.fragments_unanswered", "transaction.unanswered", "session.cut", "session.too_many_jobs")
def joined(talk: Talk) -> None:
    """The first one was answered: the server can join them."""
    begin(talk, jobs=1)
    in_fragments(talk, read(1, dbw(1, 0)))
    talk.tell(words(1, 1))
    for reference in (2, 3):
        in_fragments(talk, read(reference, dbw(1, 0), dbw(2, 0)))
        talk.wait(SECOND)
    talk.packet(SERVER, flags=RST, after_ns=2 * SECOND)
    talk.finish()


@speaks("cotp.number_unanswered")
@explains("cotp.number_unanswered", "transaction.unanswered", "session.cut", "session.too_many_jobs")
def never_taken(talk: Talk) -> None:
    begin(talk, jobs=1)
    for number in (1, 2, 3):
        talk.packet(CLIENT, build.dt(read(number, dbw(1, 0)), number=number))
        talk.wait(SECOND)
    talk.close()


@silent("cotp.number_unanswered")
@explains_not("cotp.number_unanswered", "transaction.unanswered", "session.cut", "session.too_many_jobs")
def others_too(talk: Talk) -> None:
    """One that is not numbered stays unanswered as well."""
    begin(talk, jobs=1)
    talk.packet(CLIENT, build.dt(read(1, dbw(1, 0)), number=1), after_ns=SECOND)
    talk.packet(CLIENT, dt(read(2, dbw(1, 0))), after_ns=SECOND)
    talk.packet(CLIENT, build.dt(read(3, dbw(1, 0)), number=3), after_ns=SECOND)
    talk.packet(CLIENT, flags=RST, after_ns=SECOND)
    talk.finish()


# ---- a confirm without TSAPs ----------------------------------------------------------------------------------------

#: A confirm of 14 bytes, and one that repeats only the called TSAP.
BARE: Final = tpkt(bytes.fromhex("09d00001000200c0010a"))
HALF: Final = tpkt(bytes.fromhex("0dd00001000200c0010ac2020102"))


@speaks("cotp.bare_confirm")
def short_confirm(talk: Talk) -> None:
    talk.hello()
    talk.packet(CLIENT, CONNECT)
    assert len(BARE) == 14
    talk.packet(SERVER, BARE)
    talk.packet(CLIENT, flags=FIN | ACK)
    talk.packet(SERVER, flags=FIN | ACK)
    talk.packet(CLIENT)
    talk.finish()


@silent("cotp.bare_confirm")
def other_confirms(talk: Talk) -> None:
    """The client continues, the server ends it, the confirm has a TSAP or both, or the capture lost the rest."""
    for port, confirm, then in (
        (50000, BARE, [(CLIENT, dt(setup(0)), ACK), (CLIENT, b"", RST)]),
        (50001, BARE, [(SERVER, b"", RST)]),
        (50002, HALF, [(CLIENT, b"", RST)]),
        (50003, CONFIRM, [(CLIENT, b"", RST)]),
        (50004, BARE, [(CLIENT, None, ACK), (CLIENT, b"", FIN | ACK), (SERVER, b"", FIN | ACK)]),
    ):
        one = Talk(client_port=port, beside=talk)
        one.hello()
        one.packet(CLIENT, CONNECT)
        one.packet(SERVER, confirm)
        for side, octets, flags in then:
            if octets is None:
                one.lose(side, setup(0))
            else:
                one.packet(side, octets, flags)
    talk.finish()
