"""Scenarios of the rules about S7comm-plus sessions.

A silent scenario is the nearest harmless neighbour of one that triggers the rule.
"""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7plus.contents import VariableAddress
from dissect.protocols.s7plus.objects import Attribute, PlusObject, build_object
from dissect.protocols.s7plus.tables import (
    CREATE_OBJECT,
    DELETE_OBJECT,
    END_SEQUENCE,
    GET_MULTI_VARIABLES,
    INIT_SSL,
    SET_MULTI_VARIABLES,
    SET_VARIABLE,
)
from dissect.protocols.s7plus.value_tables import ARRAY, DINT, INT, STRUCT, UDINT, USINT, WSTRING
from dissect.protocols.s7plus.values import Struct, Value
from tests.engine.findings.registry import silent, speaks
from tests.engine.transactions.talk import Talk
from tests.protocols.s7plus import bodies
from tests.protocols.s7plus.pdus import asked, framed, told

MERKER: Final = VariableAddress(0, 82, 3736, [3, 100, 2])
OLD: Final = "1;6ES7 214-1HE30-0XB0 ;V2.2"
LEGACY: Final = "1;6ES7 215-1AG40-0XB0 ;V4.3"
MODERN: Final = "1;6ES7 215-1AG40-0XB0 ;V4.5"


def begun(talk: Talk) -> None:
    talk.hello()
    talk.connect()


def opened(talk: Talk, session: int = 0x386, version: str = LEGACY, challenge: bool = True) -> None:
    """A client opens a session; the CPU identifies itself, and may offer authentication by a challenge."""
    client = PlusObject(211, 287, 0, 0, 0, [Attribute(298, Value(0, WSTRING, "PANEL"))])
    talk.ask(framed(asked(1, CREATE_OBJECT, 288, 0x36, bodies.create_object(285, Value(0, UDINT, 0), client)), 1))
    about = [Attribute(306, Value(0, STRUCT, Struct(314, [(319, Value(0, WSTRING, version))])))]
    if challenge:
        about.append(Attribute(303, Value(ARRAY, USINT, list(range(20)))))
    answer = b"\0\1" + bodies.number(session) + build_object(PlusObject(session, 287, 0, 0, 0, list(about)))
    talk.tell(framed(told(1, CREATE_OBJECT, answer + bodies.FILL), 1))


def set_up(talk: Talk, session: int = 0x386, *, key: bool) -> None:
    """The client writes back what it knows of the CPU and, if it authenticates itself, an encrypted key."""
    ids = [306, 1830] if key else [306]
    values = b"".join([bodies.number(at) + b"\0\4\0" for at in range(1, len(ids) + 1)])
    numbers = bodies.number(len(ids)) * 2 + b"".join([bodies.number(id_) for id_ in ids])
    body = bodies.rid(session) + numbers + values + b"\0" + bodies.QUALIFIER + bodies.FILL
    talk.ask(framed(asked(2, SET_MULTI_VARIABLES, session, body=body)))
    talk.tell(framed(told(2, SET_MULTI_VARIABLES, b"\0\0\0" + bodies.FILL)))


def read(talk: Talk, number: int, session: int = 0x386, version: int = 2) -> None:
    talk.ask(framed(asked(number, GET_MULTI_VARIABLES, session, body=bodies.get_multi(MERKER)), version))
    talk.tell(framed(told(number, GET_MULTI_VARIABLES, bodies.multi_got([(1, Value(0, INT, 5))], [])), version))


def write(talk: Talk, number: int, integrity_id: int, session: int = 0x386) -> None:
    body = bodies.set_variable(0x3E8, [1053], Value(0, INT, 5), integrity_id)
    order = bodies.set_variable(52, [2168], Value(0, DINT, 3), integrity_id)
    talk.ask(framed(asked(number, SET_VARIABLE, session, body=order if number % 2 else body), 3))
    talk.tell(framed(told(number, SET_VARIABLE, b"\0" + bodies.end(integrity_id + number)), 3))


# ---- authentication -------------------------------------------------------------------------------------------------


@speaks("security.unauthenticated")
def without_a_key(talk: Talk) -> None:
    begun(talk)
    opened(talk)
    set_up(talk, key=False)
    for number in (3, 4):
        read(talk, number)
    talk.pipeline.exchange.report_findings()
    assert talk.slugs().count("security.unauthenticated") == 1
    (found,) = [one for one in talk.findings if one.slug == "security.unauthenticated"]
    assert found.detail.endswith(", client of unknown kind to CPU 6ES7 215-1AG40-0XB0")


@silent("security.unauthenticated")
def with_a_key_or_nothing_to_take_it(talk: Talk) -> None:
    """One client authenticates itself, another reads from a CPU without authentication; a third is refused, a fourth leaves."""
    begun(talk)
    opened(talk)
    set_up(talk, key=True)
    read(talk, 3)
    old = Talk(client_port=50001, beside=talk)
    begun(old)
    opened(old, 0x400, OLD, challenge=False)
    set_up(old, 0x400, key=False)
    read(old, 3, 0x400)
    refused = Talk(client_port=50002, beside=talk)
    begun(refused)
    opened(refused, 0x401)
    refused.ask(framed(asked(2, GET_MULTI_VARIABLES, 0x401, body=bodies.get_multi(MERKER))))
    refused.tell(framed(told(2, GET_MULTI_VARIABLES, b"\xff" * 8 + b"\x9c\0\0" + bodies.FILL)))
    leaves = Talk(client_port=50003, beside=talk)
    begun(leaves)
    opened(leaves, 0x402)
    leaves.ask(framed(asked(2, DELETE_OBJECT, 0x402, body=bodies.delete_object(0x402))))
    leaves.tell(framed(told(2, DELETE_OBJECT, b"\0" + bodies.rid(0x402) + bodies.FILL)))


# ---- TLS ------------------------------------------------------------------------------------------------------------


@speaks("security.clear_text")
def a_modern_cpu_in_clear_text(talk: Talk) -> None:
    begun(talk)
    opened(talk, version=MODERN)


@silent("security.clear_text")
def an_older_cpu_or_tls(talk: Talk) -> None:
    """Firmware without TLS, unknown product numbers, and a client that requested TLS before it opened the session."""
    texts = (
        LEGACY,
        "1;6ES7 511-1AK00-0AB0;V2.8",
        "1;6ES7 999-1AK00-0AB0;V9.9",
        "1;6ES7 511-1AK00-0AB0;Vx.y",
        "1;6ES7 511-1AK00-0AB0;V9",
        f"1;6ES7 511-1AK00-0AB0;V{'9' * 5000}.3",
        f"1;6ES7 511-1AK00-0AB0;V9.{'3' * 5000}",
        "1;6ES7 511-1AK00-0AB0;V\u0669.9",
        "nothing",
    )
    for at, version in enumerate(texts):
        one = Talk(client_port=50001 + at, beside=talk)
        begun(one)
        opened(one, 0x400 + at, version)
    begun(talk)
    talk.ask(framed(asked(0, INIT_SSL, 288, 0x30, bodies.FILL), 1))
    talk.tell(framed(told(0, INIT_SSL, b"\0" + bodies.FILL), 1))
    opened(talk, version=MODERN)


# ---- whose session --------------------------------------------------------------------------------------------------


@speaks("security.session_reused")
def a_session_of_someone_else(talk: Talk) -> None:
    """Requests of the first connection are sent again on a second one, which opened no session."""
    begun(talk)
    opened(talk, challenge=False)
    read(talk, 2)
    again = Talk(client_port=50001, beside=talk)
    begun(again)
    for number in (2, 3):
        read(again, number)
    talk.pipeline.exchange.report_findings()
    assert talk.slugs().count("security.session_reused") == 1


@silent("security.session_reused")
def a_session_that_is_given_again(talk: Talk) -> None:
    """The CPU gives the number of a closed session to the next client; and a capture begins in the middle of a connection."""
    begun(talk)
    opened(talk, challenge=False)
    read(talk, 2)
    talk.close()
    again = Talk(client_port=50001, beside=talk)
    begun(again)
    opened(again, challenge=False)
    read(again, 2)
    late = Talk(client_port=50002, beside=talk)
    read(late, 7)


# ---- numbers of requests --------------------------------------------------------------------------------------------


@speaks("security.replay")
def a_request_comes_again(talk: Talk) -> None:
    begun(talk)
    opened(talk, challenge=False)
    read(talk, 2)
    read(talk, 3)
    read(talk, 2)


@silent("security.replay")
def numbers_that_count_up(talk: Talk) -> None:
    """Up to the largest and from 0 again, with a lost request in between; then a new session begins."""
    begun(talk)
    opened(talk, challenge=False)
    for number in (2, 3, 5, 30000, 60000, 65535, 0, 1):
        read(talk, number)
    opened(talk, 0x387, challenge=False)
    body = b"\0\0" + bodies.end(7)
    talk.ask(framed(asked(2, END_SEQUENCE, 0x387, body=body), 3))
    talk.tell(framed(told(2, END_SEQUENCE, b"\0" + bodies.end(9)), 3))
    for number, integrity_id in ((3, 8), (5, 10), (7, 12)):
        write(talk, number, integrity_id, 0x387)


# ---- protection and firmware ----------------------------------------------------------------------------------------


@speaks("security.protection")
def a_password_of_the_cpu_is_written(talk: Talk) -> None:
    """One attribute, or among several, also after reported writes of variables."""
    begun(talk)
    variable = VariableAddress(0, 82, 3736, [3, 1, 1])
    for number, pairs in enumerate(
        (
            [(variable, Value(0, INT, 1))],
            [(VariableAddress(0, 81, 3736, [3, 1, 1]), Value(0, INT, 1))],
            [(variable, Value(0, INT, 1)), (VariableAddress(0, 50, 3451, []), Value(0, DINT, 1))],
        ),
        1,
    ):
        talk.ask(framed(asked(number, SET_MULTI_VARIABLES, body=bodies.set_multi(pairs)), 3))
        talk.tell(framed(told(number, SET_MULTI_VARIABLES, b"\0\0\0" + bodies.end(9)), 3))
    for number, attribute in enumerate((3451, 7918, 7921), 4):
        body = bodies.set_variable(50, [attribute], Value(0, DINT, 1))
        talk.ask(framed(asked(number, SET_VARIABLE, body=body), 3))
        talk.tell(framed(told(number, SET_VARIABLE, b"\0" + bodies.end(9)), 3))
    talk.pipeline.exchange.report_findings()
    assert [one.detail.partition(": ")[2] for one in talk.findings if one.slug == "security.protection"] == [
        "write CPUcommon.CPUProtectionLevel, accepted",
        "write CPUcommon.CPUProtectionLevel, accepted",
        "write CPUcommon.CPUPassword, accepted",
        "write CPUcommon.CPUPasswordFailsafe, accepted",
    ]


@silent("security.protection")
def other_attributes_and_variables_with_its_numbers(talk: Talk) -> None:
    begun(talk)
    for number, (object_id, ids) in enumerate(((50, [2407]), (0x8A0E0001, [2550, 3451]), (82, [3736, 7918])), 1):
        talk.ask(framed(asked(number, SET_VARIABLE, body=bodies.set_variable(object_id, ids, Value(0, INT, 1))), 3))
        talk.tell(framed(told(number, SET_VARIABLE, b"\0" + bodies.end(9)), 3))


@speaks("security.firmware")
def the_firmware_package_is_written(talk: Talk) -> None:
    """An object is created in it, it is created itself inside another, or an attribute is written."""
    begun(talk)
    inside = PlusObject(0x50, 1234, 0, 0, 0, [PlusObject(16, 1235, 0, 0, 0, [])])
    requests = (
        (CREATE_OBJECT, bodies.create_object(16, Value(0, INT, 0), PlusObject(211, 1236, 0, 0, 0, []), integrity_id=1)),
        (CREATE_OBJECT, bodies.create_object(1, Value(0, INT, 0), inside, integrity_id=2)),
        (SET_VARIABLE, bodies.set_variable(16, [233], Value(0, INT, 1))),
    )
    for number, (function, body) in enumerate(requests, 1):
        talk.ask(framed(asked(number, function, body=body), 3))
        talk.tell(framed(told(number, function, b"\0\0" + bodies.end(9)), 3))
    talk.pipeline.exchange.report_findings()
    assert talk.slugs().count("security.firmware") == len(requests)


@silent("security.firmware")
def other_objects_are_written(talk: Talk) -> None:
    begun(talk)
    made = bodies.create_object(17, Value(0, INT, 0), PlusObject(211, 1236, 0, 0, 0, []), integrity_id=1)
    for number, (function, body) in enumerate(
        ((CREATE_OBJECT, made), (SET_VARIABLE, bodies.set_variable(18, [233], Value(0, INT, 1)))), 1
    ):
        talk.ask(framed(asked(number, function, body=body), 3))
        talk.tell(framed(told(number, function, b"\0\0" + bodies.end(9)), 3))
