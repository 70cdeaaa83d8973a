"""Requests made anew: references, what goes on with an answer, uploads, and what fits."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from dissect.testing.golden.exchange import S7, Exchange
from dissect.testing.golden.masking import mask_s7
from dissect.testing.golden.model import Link, Transaction
from dissect.testing.playback.client.renewal import NO_MORE, NO_UPLOAD, Renewal
from tests.meaning.report.support import WORD
from tests.properties import messages

READ = messages.read_job(0x1234, [WORD])
ANSWER = messages.read_answer(0x1234, [WORD], [b"\x04\xd2"])
START = messages.pdu(messages.JOB, 1, b"\x1d\0\0\0\0\0\0\0\x09_0A00010A")
STARTED = messages.pdu(messages.ACK_DATA, 1, b"\x1d\0\x01\0\0\0\0\x07\x0700100\0\0")
UPLOAD = messages.pdu(messages.JOB, 2, b"\x1e\0\0\0\0\0\0\x07")


def transaction(request: bytes, answer: bytes) -> Transaction:
    return Transaction(Link(), "client", Exchange(S7, request, answer), "answered")


def szl(request: bool, sequence: int, unit: int, last: int) -> bytes:
    """Return a read SZL with an extended head."""
    head = bytes((0, 1, 0x12, 8, 0x12, 0x44 if request else 0x84, 1, sequence, unit, last, 0, 0))
    return messages.pdu(7, 1, head, b"\x0a\0\0\0" if request else b"\xff\x09\x00\x04\0\x11\0\0")


def test_references_are_new_each_time_and_never_zero() -> None:
    renewal = Renewal()
    numbers = [renewal.reference() for _ in range(0x1_0001)]
    assert numbers[:3] == [1, 2, 3]
    assert sorted(set(numbers)) == list(range(1, 0x1_0000))
    assert numbers[0xFFFF:] == [1, 2]


def test_a_request_differs_in_its_reference_only() -> None:
    number, octets = Renewal().renewed(READ)
    assert int.from_bytes(octets[4:6], "big") == number
    assert octets[:4] + octets[6:] == READ[:4] + READ[6:]


@given(st.binary(max_size=60))
def test_any_request_is_made_anew_without_a_raise_and_stays_the_same_but_for_references(octets: bytes) -> None:
    request = messages.pdu(messages.JOB, 1, octets)
    renewal = Renewal()
    renewal.answered(transaction(request, ANSWER), ANSWER)
    renewal.answered(transaction(request, octets), octets)
    assert mask_s7(renewal.renewed(request)[1]) == mask_s7(request)


def test_a_request_that_does_not_fit_is_refused() -> None:
    renewal = Renewal()
    wide = transaction(READ + bytes(240), b"")
    assert renewal.refusal(wide) == ""
    renewal.answered(
        transaction(messages.setup(messages.JOB, 0), messages.setup(messages.ACK_DATA, 0)),
        messages.setup(messages.ACK_DATA, 1, 1, 240),
    )
    assert renewal.pdu_length == 240
    assert "do not fit the PDU length of 240" in renewal.refusal(wide)
    assert renewal.refusal(transaction(READ + bytes(240 - len(READ)), b"")) == ""


def test_an_upload_goes_on_with_the_id_that_the_server_gives_now() -> None:
    renewal = Renewal()
    later = transaction(mask_s7(UPLOAD), b"")
    assert renewal.refusal(later) == NO_UPLOAD
    renewal.answered(transaction(START, STARTED), STARTED.replace(b"\0\0\0\x07\x07", b"\0\0\x12\x34\x07"))
    assert renewal.refusal(later) == ""
    assert renewal.renewed(later.request)[1][14:18] == b"\0\0\x12\x34"
    renewal.answered(transaction(START, STARTED), messages.pdu(2, 1, b"", error=0xD241))
    assert renewal.refusal(later) == NO_UPLOAD


def test_the_rest_of_an_answer_is_fetched_by_its_numbers_and_only_when_there_is_one() -> None:
    renewal = Renewal()
    first = transaction(messages.userdata(1, 1, 4, 1, b"\0\x11\0\0"), szl(False, 5, 9, 1))
    rest = transaction(mask_s7(szl(True, 5, 9, 0)), szl(False, 5, 9, 0))
    renewal.answered(first, szl(False, 0x21, 0x43, 1))
    assert renewal.refusal(rest) == ""
    assert renewal.renewed(rest.request)[1][17:19] == b"\x21\x43"
    renewal.answered(first, szl(False, 0x21, 0, 0))
    assert renewal.refusal(rest) == NO_MORE


def test_who_sends_in_parts_counts_them_itself() -> None:
    renewal = Renewal()

    def part(reference: int, sequence: int, last: int) -> bytes:
        head = bytes((0, 1, 0x12, 8, 0x12, 0x46, 1, sequence, reference, last, 0, 0))
        return messages.pdu(7, reference, head, b"\xff\x09\0\x08\x12\x06\x13\0\0\0\0\1")

    told = messages.pdu(7, 1, bytes((0, 1, 0x12, 8, 0x12, 0x86, 1, 0x33, 0, 0, 0, 0)), b"\x0a\0\0\0")
    begin = transaction(part(2, 0, 1), told)
    number, octets = renewal.renewed(begin.request)
    assert octets[17:19] == bytes((0, number))
    renewal.answered(begin, told)
    number, octets = renewal.renewed(transaction(part(3, 0x33, 0), told).request)
    assert octets[17:19] == bytes((0x33, number))
