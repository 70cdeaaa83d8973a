"""A read that is sent again is known again, whatever its numbers are; any other one is not."""

from __future__ import annotations

from typing import Final

import pytest

from dissect.protocols.s7plus.check import check
from dissect.protocols.s7plus.contents import VariableAddress
from dissect.protocols.s7plus.ending import FILL
from dissect.protocols.s7plus.reads import Reads, reads_again
from dissect.protocols.s7plus.tables import GET_MULTI_VARIABLES
from tests.protocols.s7plus import bodies
from tests.protocols.s7plus.bodies import QUALIFIER, number
from tests.protocols.s7plus.pdus import asked, framed

STATE: Final = VariableAddress(0, 52, 2237, [3486])
WORD: Final = VariableAddress(0, 82, 3736, [3, 100, 2])
WANTED: Final = bodies.addresses(WORD, STATE)


def request(end: bytes, version: int, sequence: int = 7, wanted: bytes = WANTED, behind: bytes = QUALIFIER) -> bytes:
    return framed(asked(sequence, GET_MULTI_VARIABLES, 0x386 + sequence, body=wanted + behind + end), version)


def before(version: int) -> Reads:
    return Reads(check(request(number(9) + bytes(4), version) if version > 1 else request(bytes(4), version)))


@pytest.mark.parametrize("version", [1, 2, 3])
def test_it_says_what_the_request_asks(version: int) -> None:
    said = before(version)
    assert (said.sound, said.odd, said.asks, said.item) == (True, False, True, 2)
    assert said.place == (37 if version == 3 else 4) + 14 + len(WANTED)
    other = Reads(check(framed(asked(7, GET_MULTI_VARIABLES, body=bodies.get_multi(WORD)), 3)))
    assert (other.sound, other.asks, other.item) == (True, False, 0)
    lying = Reads(check(framed(asked(7, GET_MULTI_VARIABLES, body=WANTED + b"\0"), 3)))
    assert (lying.sound, lying.odd) == (False, True)


@pytest.mark.parametrize(
    ("end", "versions"),
    [
        (b"", (1, 2, 3)),
        (bytes(FILL - 1), (1, 2, 3)),
        (bytes(FILL), (1, 2, 3)),
        (number(300) + bytes(4), (2, 3)),
        (number(2**32 - 1) + bytes(5), (2, 3)),
        (b"\x20" + bytes(range(32)), (2,)),
        (number(5) + b"\x20" + bytes(range(32)), (2, 3)),
        (bytes(3), ()),
        (b"\1", ()),
        (b"\x80\x80", ()),
        (number(5) + bytes(3), ()),
        (number(5) + bytes(4) + b"\1", ()),
    ],
)
def test_its_end_may_be_any_that_is_sound(end: bytes, versions: tuple[int, ...]) -> None:
    """One that the check finds sound as well."""
    for version in (1, 2, 3):
        octets = request(end, version, 8)
        assert reads_again(octets, WANTED, before(version)) == (version in versions)
        assert check(octets).sound == (version in versions)


@pytest.mark.parametrize("version", [1, 2, 3])
def test_another_read_is_none_of_the_same(version: int) -> None:
    said = before(version)
    end = bytes(4)
    whole = request(end, version)
    assert reads_again(whole, WANTED, said)
    for at in range(len(WANTED)):
        changed = WANTED[:at] + bytes((WANTED[at] ^ 1,)) + WANTED[at + 1 :]
        assert not reads_again(request(end, version, wanted=changed), WANTED, said)
    for at in range(len(QUALIFIER)):
        changed = QUALIFIER[:at] + bytes((QUALIFIER[at] ^ 1,)) + QUALIFIER[at + 1 :]
        assert not reads_again(request(end, version, behind=changed), WANTED, said)
    for wanted in (WANTED[:-1], WANTED + b"\0", WANTED[1:], b"", bodies.addresses(WORD)):
        assert not reads_again(request(end, version, wanted=wanted), WANTED, said)
    for cut in range(len(WANTED + QUALIFIER)):
        shorter = (WANTED + QUALIFIER)[:cut]
        assert not reads_again(request(b"", version, wanted=shorter, behind=b""), WANTED, said)
    for cut in range(len(whole)):
        assert not reads_again(whole[:cut], WANTED, said)
    assert not reads_again(whole + b"\0", WANTED, said)
    assert not reads_again(request(end, 5 - version if version > 1 else 3), WANTED, said)
    data = asked(7, GET_MULTI_VARIABLES, body=WANTED + QUALIFIER + end)
    assert not reads_again(framed(data[:40], version, False) + framed(data[40:], version), WANTED, said)


def test_after_a_read_that_lies_none_is_known() -> None:
    said = Reads(check(framed(asked(7, GET_MULTI_VARIABLES, body=WANTED + QUALIFIER + b"\1"), 2)))
    assert not said.sound
    assert not reads_again(request(bytes(4), 2), WANTED, said)
