from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.engine.transactions.results import (
    BAD_DATA,
    BAD_REQUEST,
    COUNT_MISMATCH,
    ODD_DATA_CODE,
    SIZE_MISMATCH,
    UNCONFIRMED,
    WRITE_SIZE,
    check_written,
    error_code,
    mismatch,
)
from dissect.engine.transactions.transaction import Transaction
from dissect.protocols.s7.items import odd_data_code, parse_data_items
from dissect.protocols.s7.parameters import Parameters, parse_parameters
from dissect.protocols.s7.tables import ACK_DATA, ELEMENT_OCTETS, JOB, USERDATA
from dissect.wire.malformed import Malformed
from tests.engine.transactions.talk import (
    Talk,
    ack,
    ack_data,
    dbw,
    good,
    granted,
    head,
    item,
    read,
    refused,
    setup,
    userdata,
    words,
    write,
    written,
)


@pytest.fixture
def talk() -> Talk:
    """A connection that is set up."""
    talk = Talk()
    talk.open(8, 8)
    return talk


def only(talk: Talk) -> Transaction:
    assert len(talk.transactions) == 1
    return talk.transactions[0]


ASKED = read(1, dbw(1, 0), dbw(1, 2))


@pytest.mark.parametrize(
    ("request_octets", "answer", "flags", "errors"),
    [
        (ASKED, ack_data(1, b"\x04\x02", good(4, b"\0\1") * 2), 0, False),
        (ASKED, ack_data(1, b"\x04\x02", good(4, b"\0\1") + refused(5)), 0, True),
        (ASKED, ack_data(1, b"\x04\x01", good(4, b"\0\1")), COUNT_MISMATCH, False),
        (ASKED, ack_data(1, b"\x04\x03", good(4, b"\0\1") * 3), COUNT_MISMATCH, False),
        (ASKED, ack_data(1, b"\x04\x02", good(4, b"\0\1") * 3), BAD_DATA, False),
        (ASKED, ack_data(1, b"\x04\x02", good(4, b"\0\1")), BAD_DATA, False),
        (ASKED, ack_data(1, b"\x04\x02", good(4, b"\0\1") + b"\xff\x04\x00\x10\x00"), BAD_DATA, False),
        (ASKED, ack_data(1, b"\x04\x02", good(4, b"\0\1") + good(4, b"\0\1\2\3")), SIZE_MISMATCH, False),
        (ASKED, ack_data(1, b"\x04\x02", good(4, b"\0\1\2") + b"\0" + good(4, b"\0\1")), SIZE_MISMATCH, False),
        (ASKED, ack_data(1, b"\x04\x02", good(4, b"\0\1\2\3") * 2), SIZE_MISMATCH, False),
        (ASKED, ack_data(1, b"\x04\x02", good(4, b"\0\1") * 2 + b"\0"), BAD_DATA, False),
        (ASKED, ack_data(1, b"\x04\x02", b"", 0x8500), 0, True),
        (ASKED, ack_data(1, b"\x04\x02", b""), BAD_DATA, False),
        (ASKED, ack_data(1, b"\x04\x00", b""), COUNT_MISMATCH, False),
        # An item of no octets: that many are asked for.
        (read(1, dbw(1, 0, 0)), ack_data(1, b"\x04\x01", good(4, b"")), 0, False),
        (read(1, dbw(1, 0, 0)), ack_data(1, b"\x04\x01", good(4, b"\0\1")), SIZE_MISMATCH, False),
        (read(1, dbw(1, 0, 0), dbw(1, 2)), ack_data(1, b"\x04\x02", good(4, b"\0\1") * 2), SIZE_MISMATCH, False),
        # An odd last item may be padded.
        (read(1, dbw(1, 0)[:3] + b"\x02\x00\x03" + dbw(1, 0)[6:]), ack_data(1, b"\x04\x01", good(4, b"abc")), 0, False),
        (
            read(1, dbw(1, 0)[:3] + b"\x02\x00\x03" + dbw(1, 0)[6:]),
            ack_data(1, b"\x04\x01", good(4, b"abc") + b"\0"),
            0,
            False,
        ),
        (
            read(1, dbw(1, 0)[:3] + b"\x02\x00\x03" + dbw(1, 0)[6:]),
            ack_data(1, b"\x04\x01", good(4, b"abc") + b"\0\0"),
            BAD_DATA,
            False,
        ),
        # 0x06 counts octets for some devices, bits for others.
        (
            read(1, dbw(1, 0)[:3] + b"\x07\x00\x01" + dbw(1, 0)[6:]),
            ack_data(1, b"\x04\x01", b"\xff\x06\x00\x04\0\0\0\1"),
            ODD_DATA_CODE,
            False,
        ),
        (
            read(1, dbw(1, 0)[:3] + b"\x07\x00\x01" + dbw(1, 0)[6:]),
            ack_data(1, b"\x04\x01", b"\xff\x06\x00\x20\0\0\0\1"),
            ODD_DATA_CODE,
            False,
        ),
        # Writes.
        (write(1, [dbw(1, 0)], written(4, b"\0\1")), ack_data(1, b"\x05\x01", b"\xff"), 0, False),
        (write(1, [dbw(1, 0)], written(4, b"\0\1")), ack_data(1, b"\x05\x01", b"\x05"), 0, True),
        (write(1, [dbw(1, 0)], written(4, b"\0\1")), ack_data(1, b"\x05\x02", b"\xff\xff"), COUNT_MISMATCH, False),
        (write(1, [dbw(1, 0)], written(4, b"\0\1")), ack_data(1, b"\x05\x01", b"\xff\xff"), BAD_DATA, False),
        (write(1, [dbw(1, 0)], written(4, b"\0\1")), ack_data(1, b"\x05\x01", b""), BAD_DATA | UNCONFIRMED, True),
        (write(1, [dbw(1, 0)], written(4, b"\0\1")), ack_data(1, b"\x05\x01", b"", 0x8500), 0, True),
        (write(1, [dbw(1, 0)], written(4, b"\0\1")[:-1]), ack_data(1, b"\x05\x01", b"\xff"), BAD_REQUEST, False),
        (write(1, [dbw(1, 0)], written(4, b"\0\1") * 2), ack_data(1, b"\x05\x01", b"\xff"), BAD_REQUEST, False),
        (write(1, [dbw(1, 0)], b""), ack_data(1, b"\x05\x01", b"\x07"), BAD_REQUEST, True),
        (write(1, [dbw(1, 0)], written(4, b"\0\1\2") + b"\0"), ack_data(1, b"\x05\x01", b"\xff"), WRITE_SIZE, False),
    ],
)
def test_what_is_odd_about_an_answer(
    talk: Talk, request_octets: bytes, answer: bytes, flags: int, errors: bool
) -> None:
    talk.ask(request_octets)
    talk.tell(answer)
    one = only(talk)
    assert (one.outcome, one._flags, one.has_errors) == ("answered", flags, errors)
    assert bool(one.errors) is errors


def test_an_answer_like_the_one_before_is_taken_by_its_heads(talk: Talk) -> None:
    """What the items of a good answer began with is remembered, and hides nothing of answers that differ."""
    sound = good(4, b"\0\1") * 2
    told = [
        (sound, 0, False),
        (sound, 0, False),
        (good(4, b"\0\1") + refused(5), 0, True),
        (good(4, b"\0\1") + good(4, b"\0\1\2\3"), SIZE_MISMATCH, False),
        (sound[:-1], BAD_DATA, False),
        (sound + b"\0", BAD_DATA, False),
        (sound[:-3], BAD_DATA, False),
        (sound, 0, False),
    ]
    for number, (data, _, _) in enumerate(told, 1):
        talk.ask(read(number, dbw(1, 0), dbw(1, 2)))
        talk.tell(ack_data(number, b"\x04\x02", data))
    assert [(one._flags, one.has_errors) for one in talk.transactions] == [(flags, errors) for _, flags, errors in told]
    remembered = talk.transactions[0].parameters.good_answer
    assert struct.unpack(">qIIII", remembered) == (len(sound), 0, 0xFF040010, 6, 0xFF040010)


def test_a_length_that_needs_the_octets_left_is_taken_by_them(talk: Talk) -> None:
    asked = dbw(1, 0)[:3] + b"\x07\x00\x01" + dbw(1, 0)[6:]
    for number, octets in enumerate((b"\0\0\0\1", b"\0\0"), 1):
        talk.ask(read(number, asked))
        talk.tell(ack_data(number, b"\x04\x01", b"\xff\x06\x00\x04" + octets))
    assert [one._flags for one in talk.transactions] == [ODD_DATA_CODE, SIZE_MISMATCH]


@pytest.mark.parametrize("sizes", [(1, 2), (2, 1), (3, 1, 1), (1,), (1, 1, 1, 5)])
def test_places_of_remembered_items_allow_for_fill(talk: Talk, sizes: tuple[int, ...]) -> None:
    data = b"".join([good(4, bytes(size)) + bytes(size & 1) for size in sizes])
    whole = data[:-1] if sizes[-1] & 1 else data
    asked = [dbw(1, 0)[:3] + b"\x02" + size.to_bytes(2, "big") + dbw(1, 0)[6:] for size in sizes]
    at, last = 0, b""
    for size in sizes:
        last += struct.pack(">II", at, 0xFF040000 | 8 * size)
        at += 4 + size + (size & 1)
    told = [(whole, False)] * 2
    for number in range(len(sizes)):
        start = struct.unpack_from(">I", last, 8 * number)[0]
        told.append((whole[:start] + b"\x05" + whole[start + 1 :], True))
    told += [(whole, False)]
    for number, (answer, _) in enumerate(told, 1):
        talk.ask(read(number, *asked))
        talk.tell(ack_data(number, bytes((4, len(sizes))), answer))
    assert talk.transactions[0].parameters.good_answer == struct.pack(">q", len(whole)) + last
    assert [one.has_errors for one in talk.transactions] == [errors for _, errors in told]
    assert [one._flags for one in talk.transactions if not one.has_errors] == [0, 0, 0]


def test_lengths_told_once_are_not_told_again(talk: Talk) -> None:
    """A PDU whose header lies is one malformed finding, not two."""
    whole = write(1, [dbw(1, 0)], written(4, b"\0\1"))
    talk.ask(whole[:-1])
    talk.tell(ack_data(1, b"\x05\x01", b"\xff"))
    answer = words(2, 1)
    talk.ask(read(2, dbw(1, 0)))
    talk.tell(answer[:8] + b"\x00\x03" + answer[10:])
    assert [one._flags for one in talk.transactions] == [0, 0]
    assert talk.slugs().count("s7.malformed") == 2


def test_a_refused_setup_grants_nothing(talk: Talk) -> None:
    connection = talk.pipeline.table.all_open()[0].connection
    talk.ask(setup(1, 2, 2, 960))
    talk.tell(ack_data(1, granted(1, 5, 5, 480)[12:], b"", 0x8104))
    assert (connection.pdu_length, connection.jobs_allowed(0)) == (480, 8)
    talk.ask(setup(2, 2, 2, 960))
    talk.tell(granted(2, 2, 1, 240))
    assert (connection.pdu_length, connection.jobs_allowed(0), connection.jobs_allowed(1)) == (240, 1, 2)


def test_who_sends_the_setup_is_calling() -> None:
    """Seen from the side that asked: "called" is how many jobs it may have open, "calling" how many the other side may."""
    for asks in (0, 1):
        talk = Talk()
        talk.hello()
        talk.connect()
        first, second = (talk.ask, talk.tell) if asks == 0 else (talk.tell, talk.ask)
        first(setup(1, 3, 2, 480))
        second(granted(1, 3, 2, 240))
        connection = talk.pipeline.table.all_open()[0].connection
        assert (connection.jobs_allowed(asks), connection.jobs_allowed(1 - asks)) == (2, 3)


def test_an_ack_has_no_items(talk: Talk) -> None:
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(ack(1, 0, b"\x04\x01"))
    assert (only(talk)._flags, only(talk).has_errors) == (0, False)
    assert [(result.return_code, result.data) for result in only(talk).s7_results] == [(-1, None)]


def parameters(octets: bytes) -> Parameters:
    """The parameters of a PDU."""
    size = 12 if octets[1] in {2, 3} else 10
    return parse_parameters(octets[size : size + int.from_bytes(octets[6:8], "big")], octets[1])


@pytest.mark.parametrize(
    ("asked", "told", "misfit"),
    [
        (read(1), words(1, 1), False),
        (read(1), ack(1, 0x8104), False),
        (read(1), ack(1, 0x8104, b"\x04"), False),
        (read(1), ack(1, 0x8104, b"\x05"), True),
        (read(1), ack_data(1, b"\x05\x00"), True),
        (userdata(1, head(1, 4, 1)), userdata(1, head(2, 4, 1, 7, 0)), False),
        (userdata(1, head(1, 4, 1)), userdata(1, head(2, 4, 2)), True),
        (userdata(1, head(1, 4, 1)), userdata(1, head(2, 3, 1)), True),
    ],
)
def test_mismatch(asked: bytes, told: bytes, misfit: bool) -> None:
    assert mismatch(parameters(asked), parameters(told)) is misfit


@given(st.binary(max_size=30), st.integers(0, 3))
def test_what_is_written_is_looked_at_within_its_pdu(data: bytes, count: int) -> None:
    octets = write(1, [dbw(1, 0)] * count, data)
    fits = not check_written(parameters(octets), b"\xff" * 5 + octets + b"\xff" * 9, 5, len(octets))
    reached = 0
    for _ in range(count):
        if reached + 4 > len(data):
            break
        size = int.from_bytes(data[reached + 2 : reached + 4], "big")
        size = (size + 7) // 8 if data[reached + 1] in {3, 4, 5} else size
        reached += 4 + size
    else:
        assert not fits or len(data) <= reached + count
        return
    assert not fits


SIZES = st.lists(st.sampled_from([(1, 1), (2, 1), (2, 3), (4, 1), (6, 2), (8, 1)]), min_size=1, max_size=3)
HEADS = st.tuples(st.sampled_from([0xFF, 0xFF, 0x0A, 0]), st.sampled_from([3, 4, 5, 6, 7, 9]), st.integers(0, 40))


def asked_for(sizes: list[tuple[int, int]], sound: bool) -> list[bytes]:
    """Items of these transport sizes and counts; the block is plain if ``sound``, else its first item has an odd address."""
    return [
        item(0x84, 1, number * 64 + (0 if sound or number else 1 << 19), *size) for number, size in enumerate(sizes)
    ]


def data_of(heads: list[tuple[int, int, int]], sizes: list[tuple[int, int]], lie: int) -> bytes:
    """Data items with these return codes and transport sizes, with the right lengths but for ``lie``."""
    parts: list[bytes] = []
    for (code, transport, length), (size, count) in zip(heads, sizes, strict=False):
        octets = ELEMENT_OCTETS[size] * count
        stated = length if lie else octets * 8 if transport in {3, 4, 5} else octets
        body = b"" if code == 0x0A else bytes(octets)
        parts.append(bytes([code, transport]) + stated.to_bytes(2, "big") + body + bytes(len(body) % 2))
    return b"".join(parts)


@given(SIZES, st.lists(HEADS, min_size=3, max_size=3), st.integers(0, 1), st.booleans(), st.integers(0, 2))
def test_the_data_of_a_write_are_judged_as_its_data_items_are(
    sizes: list[tuple[int, int]], heads: list[tuple[int, int, int]], lie: int, sound: bool, short: int
) -> None:
    data = data_of(heads, sizes, lie)
    octets = write(1, asked_for(sizes, sound), data[: len(data) - short])
    asked = parameters(octets)
    assert asked.plain is sound
    told: list[Malformed] = []
    found = parse_data_items(octets, 10 + len(asked.octets), len(octets), len(sizes), False, told)
    fits = [0 <= one.size == len(each.data) for one, each in zip(asked.items, found, strict=False)]
    assert check_written(asked, octets, 0, len(octets)) == (BAD_REQUEST if told else 0 if all(fits) else WRITE_SIZE)


@given(SIZES, st.lists(HEADS, min_size=3, max_size=3), st.integers(0, 1), st.booleans(), st.integers(0, 2))
def test_the_transport_sizes_of_an_answer_are_judged_as_its_data_items_are(
    sizes: list[tuple[int, int]], heads: list[tuple[int, int, int]], lie: int, sound: bool, short: int
) -> None:
    data = data_of(heads, sizes, lie)
    talk = Talk()
    talk.open(8, 8)
    talk.ask(read(1, *asked_for(sizes, sound)))
    talk.tell(ack_data(1, bytes([4, len(sizes)]), data[: len(data) - short]))
    one = only(talk)
    assert one.parameters.plain is sound
    if one._flags & BAD_DATA:
        assert one.parameters.answer_unjudged
        return
    pairs = [(each.item, each.answer) for each in one.s7_results if each.return_code == 0xFF]
    odd = [item is not None and answer is not None and odd_data_code(item, answer) for item, answer in pairs]
    assert bool(one._flags & ODD_DATA_CODE) is any(odd)
    assert one.parameters.answer_unjudged is not bool(pairs)


def test_error_codes() -> None:
    def code(octets: bytes) -> int:
        return error_code(octets[1], octets, parameters(octets))

    assert code(ack(1, 0x8104)) == 0x8104
    assert code(ack_data(1, b"\x28\x02", b"", 0xD2A9)) == 0xD2A9
    assert code(words(1, 1)) == 0
    assert code(userdata(1, head(2, 4, 1, 1, 0xD402))) == 0xD402
    assert code(userdata(1, head(2, 4, 1))) == 0
    assert error_code(ACK_DATA, words(1, 1)[:11], Parameters(b"", ACK_DATA)) == 0
    assert error_code(USERDATA, userdata(1, b""), Parameters(b"", USERDATA)) == 0
    assert error_code(JOB, read(1), parameters(read(1))) == 0


@given(
    st.binary(max_size=24),
    st.sampled_from([b"", b"\x04", b"\x05", b"\x04\x01", b"\x04\x03", b"\x05\x02"]),
    st.integers(0, 1),
)
def test_errors_are_there_when_they_are_said_to_be(data: bytes, told: bytes, code: int) -> None:
    """`has_errors` comes from stepping over the octets, `errors` from decoding them: they agree on anything."""
    for asked in (read(1, dbw(1, 0), item(0x83, 0, 3, 1)), write(1, [dbw(1, 0)], written(4, b"\0\1"))):
        for size in (len(data), max(len(data) - 3, 0)):  # a header that lies as well
            answer = ack_data(1, told, data, code * 0x8104)
            answer = answer[:8] + size.to_bytes(2, "big") + answer[10:]
            talk = Talk()
            talk.open(8, 8)
            talk.ask(asked)
            talk.tell(answer)
            one = only(talk)
            assert bool(one.errors) is one.has_errors
            assert len(one.s7_results) <= max(2, len(data))


PLAIN_BYTES = [item(0x84, 1, 0, 2, 3), item(0x84, 1, 64, 2, 1)]


@pytest.mark.parametrize(
    ("first", "second", "odd"),
    [(4, 4, False), (4, 9, True), (9, 4, True), (9, 9, True)],
)
def test_the_transport_size_of_each_item_is_judged(talk: Talk, first: int, second: int, odd: bool) -> None:
    """CPUs answer bytes with their number of bits (4); an item of an odd size has a fill octet after it."""
    talk.ask(read(1, *PLAIN_BYTES))
    talk.tell(ack_data(1, b"\x04\x02", good(first, b"abc") + b"\0" + good(second, b"d")))
    assert bool(only(talk)._flags & ODD_DATA_CODE) is odd
    assert not only(talk)._flags & ~ODD_DATA_CODE


@pytest.mark.parametrize("refused_first", [False, True])
def test_behind_a_refused_item_transport_sizes_are_judged_all_the_same(talk: Talk, refused_first: bool) -> None:
    data = refused(10) + good(9, b"d") if refused_first else good(9, b"abc") + b"\0" + refused(10)
    talk.ask(read(1, *PLAIN_BYTES))
    talk.tell(ack_data(1, b"\x04\x02", data))
    assert only(talk)._flags == ODD_DATA_CODE


def test_a_request_whose_items_were_all_refused_is_judged_by_its_next_answer(talk: Talk) -> None:
    for number, data in enumerate((refused(10) * 2, good(9, b"abc") + b"\0" + good(4, b"d")), 1):
        talk.ask(read(number, *PLAIN_BYTES))
        talk.tell(ack_data(number, b"\x04\x02", data))
    assert [one._flags for one in talk.transactions] == [0, ODD_DATA_CODE]


@pytest.mark.parametrize("sizes", [(1, 2), (3, 1), (1, 1, 1), (5, 2, 3)])
@pytest.mark.parametrize("wrong", [-1, 0, 1])
def test_each_item_of_a_write_is_compared_with_its_data(talk: Talk, sizes: tuple[int, ...], wrong: int) -> None:
    """Odd ones have a fill octet, except the last."""
    asked = [item(0x84, 1, 64 * number, 2, size) for number, size in enumerate(sizes)]
    data = b""
    for number, size in enumerate(sizes):
        data += bytes(len(data) % 2) + written(4, bytes(size + 2 * (number == wrong)))
    talk.ask(write(1, asked, data))
    talk.tell(ack_data(1, bytes((5, len(sizes))), b"\xff" * len(sizes)))
    assert only(talk)._flags == (WRITE_SIZE if wrong >= 0 else 0)


@pytest.mark.parametrize("fault", ["", "refused", "size"])
def test_an_answer_like_a_good_one_before_is_known_by_its_heads_for_any_items(talk: Talk, fault: str) -> None:
    """Also where the block is not plain: its first item has an address that no area has."""
    asked = [item(0x84, 1, 1 << 19, 4), dbw(1, 2)]
    whole = good(4, b"\0\1") * 2
    odd = good(4, b"\0\1") + (refused(5) if fault == "refused" else good(4, b"\0\1\2\3") if fault else good(4, b"\0\1"))
    for number, data in enumerate((whole, whole, odd, whole), 1):
        talk.ask(read(number, *asked))
        talk.tell(ack_data(number, b"\x04\x02", data))
    flags = SIZE_MISMATCH if fault == "size" else 0
    assert [(one._flags, one.has_errors) for one in talk.transactions] == [
        (0, False), (0, False), (flags, fault == "refused"), (0, False),
    ]  # fmt: skip
    assert talk.transactions[0].parameters.good_answer[:8] == len(whole).to_bytes(8, "big")


def test_areas_of_one_item_are_judged_in_each_answer(talk: Talk) -> None:
    """Their return codes are in the data, so that equal heads do not make a good answer."""
    areas = bytes.fromhex("120cb00202004401600100480030")
    for number, data in enumerate(("ff0001ff7a", "ff0001ff7a", "0aff7a", "ff0001ff7b"), 1):
        octets = bytes.fromhex(data)
        talk.ask(read(number, areas))
        talk.tell(ack_data(number, b"\x04\x01", b"\xff\x09\x00" + bytes((len(octets),)) + octets))
    assert [one.has_errors for one in talk.transactions] == [False, False, True, False]


def test_an_answer_with_an_error_code_has_items_or_has_none(talk: Talk) -> None:
    """None are missing where the whole request is refused; those that come all the same are looked at."""
    for number, (data, code) in enumerate(
        ((b"", 0x8500), (b"\xff", 0x8500), (b"\x05", 0x8500), (b"\xff\xff", 0x8500)), 1
    ):
        talk.ask(write(number, [dbw(1, 0)], written(4, b"\0\1")))
        talk.tell(ack_data(number, b"\x05\x01", data, code))
    assert [one._flags for one in talk.transactions] == [0, 0, 0, BAD_DATA]
    assert {one.has_errors for one in talk.transactions} == {True}
    assert [one.error_code for one in talk.transactions] == [0x8500] * 4


@pytest.mark.parametrize(("first", "second", "odd"), [(4, 4, False), (4, 9, True), (9, 4, True)])
def test_transport_sizes_are_judged_where_a_block_is_not_plain(talk: Talk, first: int, second: int, odd: bool) -> None:
    """An item has an address that no area has: the others are judged by their results."""
    talk.ask(read(1, item(0x84, 1, 1 << 19, 2, 3), PLAIN_BYTES[1]))
    talk.tell(ack_data(1, b"\x04\x02", good(first, b"abc") + b"\0" + good(second, b"d")))
    assert bool(only(talk)._flags & ODD_DATA_CODE) is odd
