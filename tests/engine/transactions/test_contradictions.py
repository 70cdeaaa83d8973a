"""Whether an answer can be the one to a request, judged by what both say."""

from __future__ import annotations

import pytest

from dissect.engine.transactions.contradictions import is_strange
from dissect.engine.transactions.pairing import Dialogue
from dissect.engine.transactions.results import GAPS
from dissect.engine.transactions.table import ConnectionTable
from dissect.engine.transactions.transaction import Transaction, unasked
from dissect.protocols.s7.parameters import header_size, parse_parameters
from tests.engine.transactions.talk import (
    ack,
    ack_data,
    dbw,
    good,
    granted,
    head,
    job,
    read,
    refused,
    setup,
    userdata,
    words,
    write,
    written,
)

KEY = b"\x0a\0\0\1\x0a\0\0\2\xc3\x50\0\x66"
#: Octets before and after the PDU in its buffer, which belong to other messages.
BESIDE = b"\xff\x04\x00\x10\x00\x01\x00"


def asked(octets: bytes) -> Transaction:
    """An open request."""
    side = ConnectionTable().open(KEY, 0, 1, 0)
    parameters = parse_parameters(octets[10 : 10 + int.from_bytes(octets[6:8], "big")], octets[1])
    Dialogue().ask(side, octets[1], 1, parameters, BESIDE + octets + BESIDE, len(BESIDE), len(octets), 4, 40)
    (request,) = side.connection.open_requests[0].drain()
    return request


def told(octets: bytes, to: Transaction) -> Transaction:
    """A held answer."""
    size = header_size(octets[1])
    parameters = parse_parameters(octets[size : size + int.from_bytes(octets[6:8], "big")], octets[1])
    buf = BESIDE + octets + BESIDE
    return unasked(to.connection, 0, octets[1], 1, parameters, buf, len(BESIDE), len(octets), 5, 50)


WORD = read(1, dbw(1, 0))
WRITE = write(1, [dbw(1, 0), dbw(1, 2)], written(4, b"\0\1") * 2)


@pytest.mark.parametrize(
    ("request_octets", "answer", "strange"),
    [
        (WORD, words(1, 7), False),
        (WORD, words(1, 7, 8), True),  # two words instead of one
        (WORD, ack_data(1, b"\x04\x02", good(4, b"\0\1") * 2), True),
        (WORD, ack_data(1, b"\x04\x01", refused(10)), False),
        (WORD, ack_data(1, b"\x04\x01", b"", 0x8500), False),
        (WORD, ack(1, 0x8104), False),
        (WORD, ack_data(1, b"\x05\x01", b"\xff"), True),
        (WORD, ack_data(1, b"\x04\x01", good(4, b"\0\1") + b"\0\0"), False),  # a fault of the answer, not of the pair
        (WORD, userdata(1, head(2, 4, 1, 1, 0)), True),
        (WRITE, ack_data(1, b"\x05\x02", b"\xff\xff"), False),
        (WRITE, ack_data(1, b"\x05\x02", b"\xff\x05"), False),
        (WRITE, ack_data(1, b"\x05\x01", b"\xff"), True),
        (WRITE, ack_data(1, b"\x05\x03", b"\xff\xff\xff"), True),
        (WRITE, words(1, 7), True),
        (setup(1), granted(1), False),
        (setup(1), words(1, 7), True),
        (job(1, b"\x1d" + bytes(17)), ack_data(1, b"\x1d\x00"), False),
        (job(1, b"\x1d" + bytes(17)), ack(1, 0xD209), False),
        (userdata(1, head(1, 4, 1)), userdata(1, head(2, 4, 1, 1, 0)), False),
        (userdata(1, head(1, 4, 1)), userdata(1, head(2, 4, 2, 1, 0)), True),
    ],
)
def test_an_answer_contradicts_a_request(request_octets: bytes, answer: bytes, strange: bool) -> None:
    request = asked(request_octets)
    for _ in range(3):  # a read that was answered well is known by its heads from the second time on
        assert is_strange(request, told(answer, request)) is strange


@pytest.mark.parametrize("flags", [0, GAPS])
@pytest.mark.parametrize(
    ("request_octets", "answer"),
    [
        (WORD, words(1, 7)),
        (WORD, words(1, 7, 8)),
        (WORD, ack_data(1, b"\x04\x02", refused(10) * 2)),
        (WORD, ack_data(1, b"\x04\x01", b"", 0x8500)),
        (WRITE, ack_data(1, b"\x05\x01", b"\x05")),
        (setup(1, 2, 2), granted(1, 2, 2)),
    ],
)
def test_a_request_that_an_answer_was_held_against_is_as_before(
    request_octets: bytes, answer: bytes, flags: int
) -> None:
    request = asked(request_octets)
    request._flags = flags
    is_strange(request, told(answer, request))
    assert (request._flags, request.has_errors, request.error_code, request.errors) == (flags, False, 0, [])
    assert (request.response_octets, request.response_size, request.response_rosctr) == (b"", 0, 0)
    assert (request._response_buf, request._response_offset, request.response_frame) == (b"", 0, 0)
    assert (request.response_parameters, request.outcome) == (None, "open")
    assert request.connection.granted is None


@pytest.mark.parametrize("function", [4, 5, 0x1D])
def test_data_like_those_of_a_good_answer_do_not_make_it_one(function: int) -> None:
    """Whatever is known of good answers to this read: the function of the answer decides."""
    request = asked(WORD)
    for _ in range(3):
        assert not is_strange(request, told(words(1, 7), request))
    answer = told(ack_data(1, bytes((function, 1)), good(4, b"\0\1")), request)
    assert is_strange(request, answer) is (function != 4)
    assert is_strange(request, told(ack_data(1, b"\x04\x02", good(4, b"\0\1")), request))
