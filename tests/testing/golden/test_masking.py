from __future__ import annotations

import struct

from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.s7plus.message import parse_plus
from dissect.testing.golden.masking import mask_plus, mask_s7
from tests.properties import messages
from tests.properties.messages import ACK_DATA, JOB, USERDATA, Item, pdu


@given(st.binary(max_size=60), st.booleans())
def test_never_raises_never_changes_the_size_and_is_done_at_once(octets: bytes, s7: bool) -> None:
    octets = (b"\x32" if s7 else b"\x72") + octets
    for mask in (mask_s7, mask_plus):
        once = mask(octets)
        assert len(once) == len(octets)
        assert mask(once) == once


def test_references_are_gone_and_nothing_else() -> None:
    item = Item(0x04, 1, 10, 0x84, 32)
    assert mask_s7(messages.read_job(0x1234, [item])) == messages.read_job(0, [item])
    assert mask_s7(messages.read_answer(7, [item], [b"\x12\x34"])) == messages.read_answer(0, [item], [b"\x12\x34"])


def test_userdata_loses_its_sequence_and_keeps_that_more_follows() -> None:
    def answer(sequence: int, unit: int, last: int) -> bytes:
        return pdu(USERDATA, 1, bytes((0, 1, 0x12, 8, 0x12, 0x84, 1, sequence, unit, last, 0, 0)), b"\xff\x09\x00\x00")

    assert mask_s7(answer(5, 9, 1)) == mask_s7(answer(6, 3, 1))
    assert mask_s7(answer(5, 9, 1)) != mask_s7(answer(5, 9, 0))
    assert mask_s7(answer(5, 0, 0)) != mask_s7(answer(5, 9, 0))


def test_pieces_of_a_bsend_keep_that_they_go_on() -> None:
    def piece(kind: int, sequence: int) -> bytes:
        return pdu(USERDATA, 1, bytes((0, 1, 0x12, 8, 0x12, kind, 1, sequence, 3, 1, 0, 0)), b"\xff\x09\x00\x00")

    assert mask_s7(piece(0x46, 5)) == mask_s7(piece(0x46, 6)) != mask_s7(piece(0x46, 0))
    assert mask_s7(piece(0x86, 5)) == mask_s7(piece(0x86, 0)), "what the partner answers numbers at will"
    assert mask_s7(piece(0x44, 5)) == mask_s7(piece(0x44, 0)), "so do follow-up requests of other groups"


def test_the_id_of_an_upload_is_a_reference() -> None:
    start, upload, end = b"\x1d\x00\x01\x00", b"\x1e\x00\x00\x00", b"\x1f\x00\x00\x00"
    for rosctr, block in ((ACK_DATA, start), (JOB, upload), (JOB, end)):
        first, second = (pdu(rosctr, 1, block + struct.pack(">I", number)) for number in (7, 8))
        assert mask_s7(first) == mask_s7(second)
    assert mask_s7(pdu(JOB, 1, start + b"\x00\x00\x00\x07")) != mask_s7(pdu(JOB, 1, start + b"\x00\x00\x00\x08"))


def test_plus_loses_sequence_session_and_digest() -> None:
    def request(version: int, sequence: int, session: int, digest: bytes = b"") -> bytes:
        data = struct.pack(">BHHHHIB", 0x31, 0, 0x054C, 0, sequence, session, 0x34) + b"\x00\x00\x00\x00"
        framed = (bytes((len(digest),)) + digest if digest else b"") + data
        return struct.pack(">BBH", 0x72, version, len(framed)) + framed + struct.pack(">BBH", 0x72, version, 0)

    assert mask_plus(request(2, 5, 77)) == mask_plus(request(2, 6, 78))
    masked = mask_plus(request(3, 5, 77, b"\xaa" * 32))
    assert masked == mask_plus(request(3, 6, 78, b"\xbb" * 32))
    pdu_read = parse_plus(masked)
    assert (pdu_read.function, pdu_read.sequence, pdu_read.session_id, pdu_read.malformed) == (0x054C, 0, 0, [])
