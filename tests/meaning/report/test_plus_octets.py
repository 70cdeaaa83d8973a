"""What is remembered of PDUs that were alike makes no difference: lines say what each PDU says by itself."""

from __future__ import annotations

import json
from typing import Any, Final

import pytest
from hypothesis import given
from hypothesis import strategies as st
from librt.strings import BytesWriter

from dissect.engine.observer import Observer
from dissect.engine.transactions.side import Side
from dissect.engine.transactions.transaction import Transaction
from dissect.files.session import Run
from dissect.meaning.report.plus import as_text, head_json, malformed_note, plus_notes
from dissect.meaning.report.plus_items import write_item
from dissect.meaning.report.tree_fields import meaning
from dissect.meaning.report.writers.jsonl import TransactionLines
from dissect.protocols.s7plus.alarms import ALARM, Alarm
from dissect.protocols.s7plus.contents import VariableAddress
from dissect.protocols.s7plus.hiding import reads_secret
from dissect.protocols.s7plus.ids import HIDDEN, SECRETS
from dissect.protocols.s7plus.items import Half, PlusItem, join_items
from dissect.protocols.s7plus.layouts import OBJECT_ID
from dissect.protocols.s7plus.objects import Attribute, PlusObject, build_object
from dissect.protocols.s7plus.session import REFERENCE_LIST, SUBSCRIPTION
from dissect.protocols.s7plus.stamps import _STAMPS
from dissect.protocols.s7plus.summary import summary
from dissect.protocols.s7plus.tables import (
    CREATE_OBJECT,
    EXPLORE,
    GET_LINK,
    GET_MULTI_VARIABLES,
    GET_VAR_SUBSTREAMED,
    GET_VARIABLE,
    SET_VARIABLE,
)
from dissect.protocols.s7plus.value_tables import ADDRESS_ARRAY, REAL, UDINT, WSTRING
from dissect.protocols.s7plus.values import Value, build_value
from dissect.wire.part import Part
from tests.meaning.report.support import OWN, begun, observed
from tests.properties.messages import dt
from tests.protocols.s7plus import bodies
from tests.protocols.s7plus.pdus import asked, framed, notified, told
from tests.protocols.s7plus.test_bodies import FIVE, LEVEL, LOST, WORD
from tests.protocols.s7plus.test_objects import TYPE

#: Octets of the longest PDU that is sent again; those of a published session are longer.
_LONGEST: Final = 2000


def said(half: Half | None) -> list[str]:
    """The notes of a PDU."""
    if half is None:
        return []
    wrong = half.contents.malformed
    sound = not (half.pdu.cut or half.pdu.malformed)
    texts = [f"{wrong[0].word} {wrong[0].at(half.pdu.place(wrong[0].offset))}"] if wrong and sound else []
    return plus_notes(half.pdu) + summary(half.pdu, half.contents) + texts


def head(half: Half | None) -> Any:
    return json.loads(head_json(half.pdu, half.contents.integrity_id)) if half is not None else None


def written(item: PlusItem) -> Any:
    out = BytesWriter()
    write_item(out, item)
    return json.loads(out.getvalue())


def alone(transaction: Transaction) -> dict[str, Any]:
    """What a line of S7comm-plus has to say, of this transaction as if it were the only one."""
    request, response = transaction._plus_halves(said=True)
    facts = {"request": head(request), "response": head(response)}
    objects = response.contents.objects if response is not None else []
    alarms = [json.loads(as_text(Alarm(one).as_dict())) for one in objects if one.class_id == ALARM]
    if alarms:
        facts["alarms"] = alarms
    items = join_items(request, response, transaction.connection.plus)
    tells = said(response)
    if response is not None and request is not None and reads_secret(request):
        tells = [*plus_notes(response.pdu), HIDDEN, *malformed_note(response)]
    return {"asks": said(request), "tells": tells, "s7plus": facts, "items": [written(one) for one in items]}


class Held(Observer):
    """Holds each line to what the transaction says alone, and to a writer that has seen no other."""

    def __init__(self) -> None:
        super().__init__()
        self.lines: list[dict[str, Any]] = []
        self._remembers = TransactionLines()

    def transaction(self, transaction: Transaction) -> None:
        """Keep the line."""
        line = self._remembers.line(transaction)
        assert line == TransactionLines().line(transaction)
        if transaction.is_plus:
            found = json.loads(line)
            wanted = alone(transaction)
            assert json.dumps({key: found[key] for key in wanted}) == json.dumps(wanted)
            self.lines.append(found)


class Sent(Observer):
    """Every PDU of captures, with the side that sent it."""

    def __init__(self) -> None:
        super().__init__()
        self.wants_pdus = True
        self.pdus: list[tuple[int, bytes]] = []

    def plus_pdu(self, frame: int, time_ns: int, side: Side, octets: bytes, cut: bool) -> None:
        if len(octets) <= _LONGEST:
            self.pdus.append((side.index, octets))


def published() -> list[tuple[int, bytes]]:
    """PDUs of the captures that come along, and of a session with a subscription; each is sent many times here."""
    sent = Sent()
    for path in OWN:
        if "plus" in path.name:
            run = Run([str(path)], sent)
            while run.step():
                pass
    return sent.pdus + session()


def references(*wanted: tuple[int, VariableAddress]) -> Value:
    """A new list of what a subscription is about."""
    numbers = [0x80010000, 0, len(wanted)]
    for reference, one in wanted:
        numbers += [0x80040001 + len(one.lids), reference, 0, one.area, one.crc, one.sub_area, *one.lids]
    return Value(ADDRESS_ARRAY, UDINT, list(numbers))


def subscribed(number: int, value: Value, version: int = 2) -> list[tuple[int, bytes]]:
    """A subscription, which is 0x70000e51."""
    one = PlusObject(211, SUBSCRIPTION, 0, 0, 0, [Attribute(REFERENCE_LIST, value)])
    request = asked(number, CREATE_OBJECT, body=bodies.create_object(285, FIVE, one))
    response = told(number, CREATE_OBJECT, b"\0\1" + bodies.number(NOTIFIER) + bodies.FILL)
    return [(0, framed(request, version)), (1, framed(response, version))]


def changed(number: int, *items: tuple[int, Value], version: int = 3) -> bytes:
    """A notification with values."""
    data = notified(number, NOTIFIER)[:-1] + b"".join(
        [b"\x92" + bodies.rid(at) + build_value(one) for at, one in items]
    )
    return framed(data + bytes(5), version)


def polled(number: int, id_: int, answer: bytes) -> list[tuple[int, bytes]]:
    """A read of two variables in version 3, and what answers it."""
    request = asked(number, body=bodies.get_multi(LEVEL, WORD, integrity_id=id_))
    return [(0, framed(request, 3)), (1, framed(told(number, body=answer), 3))]


NOTIFIER: Final = 0x70000E51
REAL_ONE: Final = Value(0, REAL, 1.5)
ANSWERS: Final = [
    bodies.multi_got([(1, FIVE)], [(2, LOST)]),
    bodies.multi_got([(1, FIVE), (2, REAL_ONE)], []),
    bodies.multi_got([(1, FIVE), (1, FIVE), (3, FIVE)], []),
    bodies.multi_got([], []),
    b"\xff" * 8 + b"\xf4\0\0" + bodies.end(3),
]


def session() -> list[tuple[int, bytes]]:
    """Two variables of which another subscription is made, read in version 3, and written, with answers good and bad."""
    sent = subscribed(1, references((1, LEVEL), (2, WORD)))
    sent += [(1, changed(number, (1, FIVE), (2, REAL_ONE))) for number in (1, 2)]
    sent += subscribed(2, references((1, WORD)))
    sent += [(1, changed(3, (1, FIVE), (2, REAL_ONE))), (1, changed(4, version=2)), (1, framed(notified(5)))]
    for number, answer in enumerate(ANSWERS, 3):
        sent += polled(number, number, answer)
    sent.append((0, framed(asked(8, SET_VARIABLE, body=bodies.set_variable(NOTIFIER, [1053], FIVE)), 3)))
    sent.append((1, framed(told(8, SET_VARIABLE, b"\0" + bodies.end(9)), 3)))
    sent.append((0, framed(asked(11, GET_LINK, body=bodies.rid(285) + b"\x85\x24\0\0" + bodies.end(1)), 3)))
    sent.append((1, framed(told(11, GET_LINK, b"\0\1" + bodies.rid(0x386) + bodies.end(1)), 3)))
    secret = bodies.set_variable(285, [SECRET], Value(0, WSTRING, "geheim"))
    sent.append((0, framed(asked(9, SET_VARIABLE, body=secret), 3)))
    sent.append((0, framed(asked(10, GET_VARIABLE, body=bodies.rid(285) + b"\1" + bodies.number(SECRET)), 3)))
    return [*sent, (1, framed(told(10, GET_VARIABLE, b"\0" + build_value(Value(0, WSTRING, "geheim"))), 3))]


SECRET: Final = min(SECRETS)
PDUS: Final = published()
#: PDUs that follow each other, how often they are sent, and octets of them that are others: which PDU, where, and what.
EDITS = st.lists(
    st.tuples(st.integers(0, 7), st.one_of(st.integers(-24, -1), st.integers(0, 200)), st.integers(0, 255)), max_size=2
)
RUNS = st.tuples(st.integers(0, len(PDUS) - 1), st.integers(1, 8), st.integers(1, 3), EDITS)


def held(sent: list[tuple[int, bytes]]) -> Held:
    """Let two sides say that to each other."""
    talk = begun()
    for side, octets in sent:
        talk.send(side, dt(octets))
    found = Held()
    observed(found, talk.packets())
    return found


@given(st.lists(RUNS, min_size=1, max_size=8))
def test_lines_say_what_each_pdu_says_alone(runs: list[tuple[int, int, int, list[tuple[int, int, int]]]]) -> None:
    """PDUs of real sessions, sent again and again, as they were and damaged."""
    sent: list[tuple[int, bytes]] = []
    for begin, count, often, edits in runs:
        whole = PDUS[begin : begin + count]
        damaged = [(side, bytearray(octets)) for side, octets in whole]
        for index, at, octet in edits:
            octets = damaged[index % len(damaged)][1]
            octets[at % len(octets)] = octet
        sent += whole + [(side, bytes(octets)) for side, octets in damaged] * often + whole
    held(sent)


def test_all_of_it_once_and_again() -> None:
    found = held(PDUS + session() * 2)
    assert len(found.lines) > 100


@pytest.mark.parametrize(
    ("function", "asks", "answer"),
    [
        (GET_VARIABLE, bodies.rid(285) + b"\1" + bodies.number(SECRET), b"\0"),
        (GET_VAR_SUBSTREAMED, bodies.get_stream(285, [SECRET]) + bodies.end(9), b"\0\0"),
        (GET_MULTI_VARIABLES, bodies.get_multi(VariableAddress(0, 285, SECRET, [])), b"\0\1"),
    ],
)
def test_a_secret_that_is_read_back_stands_nowhere_in_a_line(function: int, asks: bytes, answer: bytes) -> None:
    """Behind a sound answer stands a fault as well as none; the same answer to another request is shown."""
    secret = Value(0, WSTRING, "geheim")
    for end in (bodies.end(3), b"\0wrong"):
        response = framed(told(1, function, answer + build_value(secret) + end), 3)
        (line,) = held([(0, framed(asked(1, function, body=asks), 3)), (1, response)]).lines
        assert HIDDEN in line["tells"]
        assert not [form for form in ("geheim", b"geheim".hex()) if form in json.dumps(line)]
    other = bodies.rid(285) + b"\1" + bodies.number(233)
    response = framed(told(1, GET_VARIABLE, b"\0" + build_value(secret)), 3)
    (line,) = held([(0, framed(asked(1, GET_VARIABLE, body=other), 3)), (1, response)]).lines
    assert line["tells"] == ["WString 'geheim'"]


def test_an_answer_that_nobody_asked_for_has_no_items(monkeypatch: pytest.MonkeyPatch) -> None:
    """The same answer to a request has some.

    The stamp of the session is the number by which the request is remembered, which is the third PDU here.
    """
    monkeypatch.setattr(_STAMPS, "latest", 2)
    answer = bodies.multi_got([(1, FIVE), (2, REAL_ONE)], [])
    orphan = (1, framed(told(2, body=answer), 3))
    found = held([*subscribed(1, references((1, LEVEL))), *polled(3, 9, answer), orphan])
    assert [len(line["items"]) for line in found.lines] == [1, 2, 0]


def test_what_is_subscribed_to_names_what_is_notified() -> None:
    """The same notification means another variable after another list; without one it names none."""
    same = (1, changed(1, (1, FIVE)))
    first, second = subscribed(1, references((1, LEVEL))), subscribed(2, references((1, WORD)))
    found = held([same, *first, same, *second, same, same])
    names = [line["items"][0]["address"] for line in found.lines if not line["asks"]]
    assert names == [None, LEVEL.label, WORD.label, WORD.label]


def test_the_program_names_what_is_read() -> None:
    """The same read has another name behind an answer that says how the block is made up."""
    level = VariableAddress(0xAABBCCDD, 0x8A0E0003, 2550, [9])
    answer = bodies.multi_got([(1, FIVE)], [])
    same = [(0, framed(asked(1, body=bodies.get_multi(level)), 3)), (1, framed(told(1, body=answer), 3))]
    explored = b"\0" + bodies.rid(7) + bodies.number(9) + build_object(TYPE) + bodies.FILL
    asks = bodies.rid(7) + bodies.number(0) + bytes(5) + bodies.end(9)
    shown = [(0, framed(asked(2, EXPLORE, body=asks), 3)), (1, framed(told(2, EXPLORE, explored), 3))]
    found = held([*same, *same, *shown, *same])
    names = [line["items"][0]["address"] for line in found.lines if line["items"]]
    assert names == [level.label, level.label, 'DB3."level"']


def test_what_is_remembered_has_a_bound() -> None:
    """Neither PDUs that are never seen again nor those that are not sound are kept for ever."""
    held_by = TransactionLines()
    talk = begun()
    for number in range(3000):
        talk.send(1, dt(changed(1, (number, FIVE))))
        talk.send(1, dt(framed(notified(5, 0x70000000 + number) + b"wrong", 3)))

    class Lines(Observer):
        def transaction(self, transaction: Transaction) -> None:
            held_by.line(transaction)

    observed(Lines(), talk.packets())
    kept = held_by._plus_lines
    assert sum([len(alike) for alike in kept._known.values()]) <= 2048
    assert len(kept._known) == 1
    assert len(kept._items) <= 2048


@pytest.mark.parametrize(
    ("id_", "said"),
    [(0x70100459, "0x70100459"), (0x34, "0x00000034 52 NativeObjects.theCPUexecUnit_Rid"), (960, "0x000003c0 960")],
)
def test_an_id_without_a_name_is_said_once(id_: int, said: str) -> None:
    part = Part(OBJECT_ID, id_.to_bytes(4, "big"), 0, 4)
    assert [meaning(value) for value in part.values] == [said]
