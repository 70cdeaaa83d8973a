"""What S7comm-plus proves itself, and how `verify` says it."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import pytest

from dissect.protocols.s7plus.bodies import parse_contents
from dissect.protocols.s7plus.contents import VariableAddress
from dissect.protocols.s7plus.message import parse_plus
from dissect.protocols.s7plus.value_tables import INT
from dissect.protocols.s7plus.values import Value
from dissect.testing.oracle.compare import Comparison
from dissect.testing.oracle.ours import Witness
from dissect.testing.oracle.plus import PlusProof
from dissect.testing.oracle.verification import Verification
from tests.protocols.s7plus.bodies import get_multi, multi_got
from tests.protocols.s7plus.pdus import INIT_SSL, KEEP_ALIVE, asked, event, framed, notified, told

WORD: Final = VariableAddress(0, 82, 3736, [3, 100, 2])


def proof(*pdus: tuple[bytes, int]) -> PlusProof:
    found = PlusProof()
    for number, (octets, side) in enumerate(pdus, 1):
        found.take(octets, number, 1, side, False)
    return found


def answer(sequence: int, integrity_id: int) -> bytes:
    return framed(told(sequence, body=multi_got([(1, Value(0, INT, 5))], [], integrity_id)), 3)


REQUEST: Final = framed(asked(7, body=get_multi(WORD, integrity_id=0xFFFFFFFE)), 3)


def test_what_holds() -> None:
    found = proof((REQUEST, 0), (answer(7, 5), 1), (KEEP_ALIVE, 0), (event(9, b"LOGOUT"), 1))
    assert found.holds
    assert str(found) == (
        "S7comm-plus: 4 of 4 whole PDUs read to their last byte; 1 of 1 response ids = request id + sequence number"
    )


@pytest.mark.parametrize(
    ("pdus", "said"),
    [
        ([(REQUEST, 0), (answer(7, 6), 1)], "frame 2 S7comm-plus Response GetMultiVariables: integrity id 6, that of"),
        (
            [(framed(asked(7, body=get_multi(WORD) + b"\1"), 3), 0)],
            "frame 1 S7comm-plus Request GetMultiVariables: s7plus: ",
        ),
        (
            [(framed(asked(7, 0x9999, body=bytes(4))), 0)],
            "frame 1 S7comm-plus Request 0x9999: its body is not known",
        ),
        ([(framed(notified()[:-1] + b"\x77\0"), 1)], "frame 1 S7comm-plus Notification: s7plus: item at byte"),
    ],
)
def test_what_does_not_hold_is_named(pdus: list[tuple[bytes, int]], said: str) -> None:
    found = proof(*pdus)
    assert not found.holds
    assert found.faults[0].startswith(said)


def test_a_fault_stands_where_findings_and_show_see_it() -> None:
    """Counted from 0x72; the digest of version 3 stands before the data."""
    request = framed(asked(7, body=get_multi(WORD) + b"\1"), 3)
    (fault,) = proof((request, 0)).faults
    found = parse_contents(parse_plus(request)).malformed[0]
    assert f"at byte {4 + 33 + found.offset}" in fault


def test_a_pair_is_of_one_connection_and_direction() -> None:
    found = PlusProof()
    found.take(REQUEST, 1, 1, 0, False)
    found.take(answer(7, 5), 2, 1, 0, False)
    found.take(answer(7, 5), 3, 2, 1, False)
    assert (found.pairs, found.holds) == (0, True)


def test_what_is_not_whole_is_counted_and_left_out() -> None:
    found = PlusProof()
    found.take(REQUEST[:-9], 1, 1, 0, True)
    assert (found.pdus, found.cut, found.holds) == (0, 1, True)
    assert "0 of 0 whole PDUs read to their last byte, 1 not whole" in str(found)


def test_functions_without_a_known_body_prove_nothing() -> None:
    found = proof((framed(asked(7, INIT_SSL, body=bytes(4))), 0), (framed(told(7, INIT_SSL)), 1))
    assert (found.pdus, found.unknown, found.holds) == (0, 2, True)
    assert "0 of 0 whole PDUs read to their last byte, 2 of functions whose body is not known;" in str(found)


def test_the_lines_of_verify() -> None:
    verification = Verification("4.0")
    comparison = Comparison()
    assert len(verification.take("a.pcap", comparison)) == 1
    assert verification.holds
    comparison = Comparison()
    comparison.plus = proof((REQUEST, 0), (answer(7, 6), 1))
    lines = verification.take("b.pcap", comparison)
    assert lines[1].startswith("  S7comm-plus: 2 of 2 whole PDUs read")
    assert lines[2].startswith("  frame 2 S7comm-plus Response")
    assert not verification.holds
    assert len([line for line in verification.summary() if "S7comm-plus" in line]) == 1
    comparison = Comparison()
    comparison.plus = proof((REQUEST, 0), (answer(7, 5), 1), (framed(asked(7, INIT_SSL, body=bytes(4))), 0))
    comparison.plus.take(REQUEST[:-9], 9, 1, 0, True)
    verification.take("c.pcap", comparison)
    assert list(verification.summary())[1] == (
        "  S7comm-plus: 4 of 4 whole PDUs read to their last byte, 1 not whole, 1 of functions whose body is not known; "
        "1 of 2 response ids = request id + sequence number"
    )
    files = verification.as_dict()["files"]
    assert isinstance(files, list)
    assert files[1]["s7plus"] == {"pdus": 2, "read": 2, "cut": 0, "unknown": 0, "pairs": 1, "true": 0}


def test_every_shared_capture_proves_itself(corpus: Path) -> None:
    total = pairs = 0
    for path in [*sorted((corpus / "s7plus").glob("*.pcap*")), *sorted(corpus.glob("s7comm*plus*.pcap"))]:
        found = Witness(str(path)).plus
        assert found.faults == [], path.name
        assert (found.holds, found.cut) == (True, 0), path.name
        total += found.pdus
        pairs += found.pairs
    assert (total, pairs) == (2414, 611)
