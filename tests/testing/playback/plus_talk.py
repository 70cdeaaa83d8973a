"""Sessions of S7comm-plus without digests, made here: a client's requests and a server's answers, as a capture."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from dissect.protocols.s7plus.contents import VariableAddress
from dissect.protocols.s7plus.objects import PlusObject
from dissect.protocols.s7plus.session import SERVER_SESSION, SUBSCRIPTION
from dissect.protocols.s7plus.tables import CREATE_OBJECT, DELETE_OBJECT, GET_MULTI_VARIABLES, SET_MULTI_VARIABLES
from dissect.protocols.s7plus.value_tables import INT
from dissect.protocols.s7plus.values import Value, build_value
from tests.meaning.report.support import saved
from tests.properties import messages
from tests.properties.messages import dt
from tests.properties.packets import Talk
from tests.protocols.s7plus.bodies import (
    create_object,
    delete_object,
    end,
    get_multi,
    multi_got,
    number,
    rid,
    set_multi,
)
from tests.protocols.s7plus.pdus import asked, framed, told

SESSION: Final = 0x70000CB8
CONTAINER: Final = 0x70000CB9
WATCHED: Final = 0x70000E51
DB1: Final = 0x8A0E0001
VALUES: Final = 2550


def word(offset: int) -> VariableAddress:
    """A word of DB1."""
    return VariableAddress(0, DB1, VALUES, [3, offset, 2])


def value(content: int) -> Value:
    return Value(0, INT, content)


def made(*ids: int) -> bytes:
    """The answer to CreateObject."""
    return b"\0" + bytes((len(ids),)) + b"".join([number(one) for one in ids]) + bytes(4)


def notified(sequence: int, *items: tuple[int, int]) -> bytes:
    """A notification: references and values."""
    head = b"\x33" + rid(WATCHED) + b"\x04\0\0\0\0\0" + bytes((sequence,)) + number(sequence) + b"\x01"
    return (
        head + b"".join([b"\x92" + rid(one) + build_value(value(content)) for one, content in items]) + b"\0" + bytes(4)
    )


class PlusTalk:
    """A conversation; ``ask`` and ``tell`` take bodies, sequence numbers go up."""

    def __init__(self, version: int = 2) -> None:
        self.talk = Talk().handshake()
        self.talk.send(0, messages.connect(0xE0)).send(1, messages.connect(0xD0))
        self.session = 0x120
        self.version = version
        self.sequence = 0

    def ask(self, function: int, body: bytes, answer: bytes) -> PlusTalk:
        self.sequence += 1
        octets = asked(self.sequence, function, self.session, body=body)
        self.talk.send(0, dt(framed(octets, self.version)))
        self.talk.send(1, dt(framed(told(self.sequence, function, answer), self.version)))
        return self

    def say(self, octets: bytes) -> PlusTalk:
        self.talk.send(1, dt(framed(octets, self.version)))
        return self

    def save(self, path: Path) -> Path:
        return saved(path, self.talk.close(0).close(1).packets())


def plant(path: Path, session: int = SESSION) -> Path:
    """A session that writes, reads and watches a word, and reads others."""
    talk = PlusTalk()
    talk.ask(
        CREATE_OBJECT,
        create_object(285, value(0), PlusObject(211, SERVER_SESSION, 0, 0, 0, [])),
        made(session, CONTAINER),
    )
    talk.session = session
    talk.ask(SET_MULTI_VARIABLES, set_multi([(word(0), value(7))], 1), b"\0\0" + end(3))
    for count in (7, 8):
        talk.ask(
            GET_MULTI_VARIABLES,
            get_multi(word(0), word(2), integrity_id=count),
            multi_got([(1, value(count)), (2, value(2))], []),
        )
    talk.ask(GET_MULTI_VARIABLES, get_multi(word(4), word(90)), multi_got([(1, value(4))], [(2, 0x8104)]))
    watched = PlusObject(0x7FFFC001, SUBSCRIPTION, 0, 0, 0, [])
    talk.ask(CREATE_OBJECT, create_object(CONTAINER, value(0), watched, integrity_id=2), made(WATCHED))
    talk.say(notified(1, (1, 7))).say(notified(2, (1, 9)))
    talk.ask(DELETE_OBJECT, delete_object(WATCHED), b"\0" + rid(WATCHED) + end(8))
    return talk.save(path)
