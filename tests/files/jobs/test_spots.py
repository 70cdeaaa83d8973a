"""Where the numbers of rows stand: what is put together is what the search for marks makes of the same rows."""

from __future__ import annotations

import random

from hypothesis import given
from hypothesis import strategies as st

from dissect.files.jobs.numbers import Offsets
from dissect.files.jobs.spots import Spots, pieces
from tests.cases import each

TRANSACTION = b"432198765"
CONNECTION = b"876543219"
#: What lines may hold beside their numbers: digits of a mark among them, and what is no text in ASCII.
REST = st.text(st.sampled_from('4321987650,:{}"é→\n x')).map(lambda text: text.encode())
BEFORE = Offsets(5, 70_000, 123_456_789)


def marked(mark: bytes, number: int) -> bytes:
    return mark + b"%09d" % number


def whole(rows: list[bytes], joint: bytes) -> tuple[bytes, bytes]:
    """Return rows and their index."""
    octets = b"".join([row + b"\n" for row in rows])
    return octets, Spots(TRANSACTION, CONNECTION, joint).index(octets, [len(row) for row in rows])


@each(("joint", "row", "there"), [
    (b',"c":', b'{"n":432198765000000001,"c":876543219000000002,"x":3}', b'{"n":123456790,"c":70002,"x":3}'),
    (b",", b"432198765000000012,876543219000000034,b", b"123456801,70034,b"),
    (b",", b"432198765000000012,876543219000000034", b"123456801,70034"),
    (b",", b"a 432198765000000012 and no more", b"a 123456801 and no more"),
    (b",", b"a 876543219000000034", b"a 70034"),
    (b"", b'{"frame":1,"c":876543219000000034,"x":432198765}', b'{"frame":1,"c":70034,"x":432198765}'),
    (b",", b"number,connection", b"number,connection"),
    (b",", b"4321987650000000", b"4321987650000000"),
    (b"", b"", b""),
])  # fmt: skip
def test_a_line(joint: bytes, row: bytes, there: bytes) -> None:
    octets, index = whole([row, row], joint)
    assert (
        b"".join(pieces(octets, index, BEFORE.transactions, BEFORE.connections, joint)) == there + b"\n" + there + b"\n"
    )


@given(
    st.integers(0, 2**32), st.lists(st.tuples(REST, REST), max_size=8), st.sampled_from([b"", b",", b',"connection":'])
)
def test_lines_of_all_kinds(seed: int, rests: list[tuple[bytes, bytes]], joint: bytes) -> None:
    chance = random.Random(seed)
    rows: list[bytes] = []
    told: list[bytes] = []
    for head, tail in rests:
        transaction, connection = chance.randint(1, 10**9 - 1), chance.randint(1, 10**9 - 1)
        own = marked(CONNECTION, connection)
        there = b"%d" % (connection + BEFORE.connections)
        if joint:
            own = marked(TRANSACTION, transaction) + joint + own
            there = b"%d" % (transaction + BEFORE.transactions) + joint + there
        rows.append(head + own + tail)
        told.append(head + there + tail)
    octets, index = whole(rows, joint)
    made = pieces(octets, index, BEFORE.transactions, BEFORE.connections, joint)
    assert b"".join(made) == b"".join([row + b"\n" for row in told])
    assert len(index) == 24 * len(rows)
