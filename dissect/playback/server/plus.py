"""The fake PLC of S7comm-plus: recorded answers for requests of versions without digests.

A request is looked for by its octets without what counts (sequence number, session id, integrity id), then, where it writes
or creates, without the values that go with it. An answer gets the sequence number of the request, and the integrity id that
belongs to it where the recorded one has an id (response id = request id + sequence number). Session ids stay those of the
recording: the answer to CreateObject tells the client which one it has.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from dissect.golden.exchange import PLUS, Exchange
from dissect.golden.keys import subject
from dissect.golden.masking import mask_plus
from dissect.golden.plus import plus_subject
from dissect.playback.plus_octets import PROTOCOL_ID, with_integrity, with_sequence
from dissect.playback.server.model import Script, Step
from dissect.s7plus.bodies import parse_contents
from dissect.s7plus.message import PlusPdu, parse_plus
from dissect.s7plus.tables import (
    CREATE_OBJECT,
    GET_MULTI_VARIABLES,
    REQUEST,
    RESPONSE,
    SET_MULTI_VARIABLES,
    SET_VARIABLE,
)
from dissect.wire.varint import VLQ, VLQ64, build_varint

#: The return value "Service unknown request" (docs/s7plus.md): no such request was recorded.
UNKNOWN_REQUEST: Final = 0xFF89
#: Requests whose values may differ from the recorded ones.
_VALUED: Final = frozenset((CREATE_OBJECT, SET_MULTI_VARIABLES, SET_VARIABLE))
#: Functions whose answers have a list of values, a list of errors, or both, each ended by a zero.
_LISTS: Final = {GET_MULTI_VARIABLES: 2, SET_MULTI_VARIABLES: 1}
_FLAGS: Final = 0x34


def renewed(answer: bytes, asked: PlusPdu) -> bytes:
    """Return a recorded answer as one to ``asked``: with its sequence number, and the integrity id that follows of it."""
    octets = with_sequence(answer, asked.sequence)
    return with_integrity(octets, max(parse_contents(asked).integrity_id, 0) + asked.sequence)


def refuse_plus(asked: PlusPdu, value: int = UNKNOWN_REQUEST) -> bytes:
    """Return the answer that refuses a request as a whole."""
    return answer_with(asked, value, bytes(_LISTS.get(asked.function, 0)))


def answer_with(asked: PlusPdu, value: int, body: bytes) -> bytes:
    """Return an answer with a return value and what follows that."""
    id_ = parse_contents(asked).integrity_id
    tail = build_varint((id_ + asked.sequence) & 0xFFFFFFFF, VLQ) if id_ >= 0 else b""
    head = bytes((RESPONSE, 0, 0)) + asked.function.to_bytes(2, "big") + bytes(2) + asked.sequence.to_bytes(2, "big")
    said = bytes((_FLAGS,)) + build_varint(value, VLQ64) + body + tail + bytes(4)
    data = head + said
    trailer = bytes((PROTOCOL_ID, asked.version, 0, 0))
    return bytes((PROTOCOL_ID, asked.version)) + len(data).to_bytes(2, "big") + data + trailer


def plus_keys(octets: bytes, pdu: PlusPdu) -> tuple[bytes, bytes]:
    """Return what a request is found by: all that counts, then without values; empty where values cannot differ."""
    about = repr((pdu.function, plus_subject(octets))).encode() if pdu.function in _VALUED else b""
    return mask_plus(octets), about


def plus_name(octets: bytes) -> str:
    """Return what a request asks for, safe to show."""
    return subject(Exchange(PLUS, octets, b""))


class PlusIndex:
    """The requests of recorded connections by their keys, in recorded order."""

    def __init__(self, scripts: Sequence[Script]) -> None:
        self.requests = [step.request for script in scripts for step in script.steps]
        self._steps: tuple[dict[bytes, list[Step]], dict[bytes, list[Step]]] = ({}, {})
        for script in scripts:
            for step in script.steps:
                for steps, key in zip(self._steps, plus_keys(step.request, parse_plus(step.request)), strict=True):
                    if key:
                        steps.setdefault(key, []).append(step)

    def steps(self, level: int, key: bytes) -> list[Step]:
        """Return the recorded requests that are alike at a level."""
        return self._steps[level].get(key, [])


def wants_answer(asked: PlusPdu) -> bool:
    """Tell whether a message is a request that an answer is due to."""
    return asked.opcode == REQUEST and asked.readable and asked.wants_response
