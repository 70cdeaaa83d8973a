"""What is read from transactions as facts about the station that was asked: one case for each rule."""

from __future__ import annotations

import struct
from typing import Final

import pytest

from dissect.engine.stations import facts
from dissect.engine.stations.evidence import Evidence, clock_time
from dissect.engine.stations.facts import Fact
from dissect.engine.transactions.results import GAPS
from dissect.protocols.s7plus.program import Program
from dissect.protocols.s7plus.session import Identity, PlusSession
from tests.build import userdata_head
from tests.cases import each
from tests.engine.findings import events
from tests.engine.findings.plus_scenarios import begun, opened
from tests.engine.stations.answers import (
    answered,
    capability,
    components,
    identification,
    listed,
    mode,
    protection,
    szl,
)
from tests.engine.transactions.talk import START_NS, Talk, head, userdata

MODULE: Final = "rack 0 slot 2"
ORDER: Final = "6ES7 315-2EH14-0AB0"


class Told(Talk):
    """A talk that keeps the facts."""

    def __init__(self) -> None:
        super().__init__()
        self.facts: list[Fact] = []

    def fact(self, fact: Fact) -> None:
        self.facts.append(fact)

    def said(self) -> list[tuple[str, str]]:
        return [(fact.key, fact.value) for fact in self.facts]


def told() -> Told:
    talk = Told()
    talk.open()
    return talk


def test_module_identification() -> None:
    talk = told()
    frame = szl(talk, 1, identification(ORDER, (3, 2, 6), 5))
    assert talk.said() == [(facts.ORDER_NUMBER, ORDER), (facts.HARDWARE, "5"), (facts.FIRMWARE, "V3.2.6")]
    fact = talk.facts[0]
    assert (fact.host, fact.module, fact.source, fact.connection) == ("10.0.0.2", MODULE, "SZL 0x0011", 1)
    assert (fact.frames, fact.fresh) == ([frame - 1, frame], True)


def test_components() -> None:
    talk = told()
    szl(talk, 1, components("S C-X1", "Station 1", "PLC_1", "Plant A"))
    assert talk.said() == [
        (facts.STATION_NAME, "Station 1"),
        (facts.MODULE_NAME, "PLC_1"),
        (facts.PLANT, "Plant A"),
        (facts.SERIAL_NUMBER, "S C-X1"),
    ]


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (mode(8), [(facts.OPERATING_MODE, "RUN")]),
        (mode(4), [(facts.OPERATING_MODE, "STOP")]),
        (protection(3), [(facts.PROTECTION, "3 (read and write protection)"), (facts.MODE_SWITCH, "RUN-P")]),
        (capability(480, 32), [(facts.MAX_PDU, "480"), (facts.MAX_CONNECTIONS, "32")]),
        (
            listed(
                0x0037, 0, struct.pack(">H", 1) + bytes((10, 0, 0, 2)) + bytes(8) + b"\x00\x1b\x1b\1\2\3" + bytes(28)
            ),
            [(facts.INTERFACE, "10.0.0.2 00:1b:1b:01:02:03")],
        ),
        (listed(0x0019, 0, bytes(4)), []),
        (struct.pack(">HHHH", 0x0F11, 0, 28, 3), []),
    ],
    ids=["run", "stop", "protection", "capability", "Ethernet", "LEDs", "head only"],
)
def test_lists(content: bytes, said: list[tuple[str, str]]) -> None:
    talk = told()
    szl(talk, 1, content)
    assert talk.said() == said


def test_an_answer_in_parts_says_the_same() -> None:
    whole = identification(ORDER, (3, 2, 6))
    talk = told()
    more, last = bytes.fromhex("0001120812840105 07010000"), bytes.fromhex("0001120812840105 07000000")
    talk.ask(userdata(1, head(1, 4, 1), b"\xff\x09\x00\x04" + whole[:4]))
    first = talk.tell(userdata(1, more, b"\xff\x09" + struct.pack(">H", 40) + whole[:40]))
    again = bytes((0, 1, 0x12, 8, 0x12, 0x44, 1, 5, 7, 1, 0, 0))
    talk.ask(userdata(2, again, b"\x0a\x00\x00\x00"))
    rest = whole[40:]
    frame = talk.tell(userdata(2, last, b"\xff\x09" + struct.pack(">H", len(rest)) + rest))
    assert talk.said() == [(facts.ORDER_NUMBER, ORDER), (facts.HARDWARE, "1"), (facts.FIRMWARE, "V3.2.6")]
    assert [fact.frames for fact in talk.facts] == [[first], [first, frame], [frame]]


def test_an_answer_in_parts_that_lacks_records_says_nothing() -> None:
    whole = identification(ORDER, (3, 2, 6))
    talk = told()
    more, last = bytes.fromhex("0001120812840105 07010000"), bytes.fromhex("0001120812840105 07000000")
    talk.ask(userdata(1, head(1, 4, 1), b"\xff\x09\x00\x04" + whole[:4]))
    first = talk.tell(userdata(1, more, b"\xff\x09" + struct.pack(">H", 40) + whole[:40]))
    again = bytes((0, 1, 0x12, 8, 0x12, 0x44, 1, 5, 7, 1, 0, 0))
    talk.ask(userdata(2, again, b"\x0a\x00\x00\x00"))
    rest = whole[68:]
    frame = talk.tell(userdata(2, last, b"\xff\x09" + struct.pack(">H", len(rest)) + rest))
    talk.close()
    assert talk.said() == []
    (found,) = [one for one in talk.findings if one.slug == "operation.wrong_size"]
    size = len(whole) - 8
    assert found.detail.endswith(f"states {size // 28} records of 28 bytes, {size - 28} bytes are there")
    assert found.frames == [first - 1, frame]


@pytest.mark.parametrize(("unit", "last", "facts_told"), [(0, 0, 2), (7, 1, 0), (7, 0, 0), (0, 1, 0)])
def test_one_part_of_an_answer_says_nothing(unit: int, last: int, facts_told: int) -> None:
    """Counts of blocks that begin or end in another part: read alone, a part may be cut within an entry."""
    talk = told()
    talk.ask(userdata(1, head(1, 3, 1), b"\x0a\x00\x00\x00"))
    entries = b"08\x00\x02" + b"0A\x00\x07"
    part = userdata_head(2, 3, 1, 5, unit, last)
    talk.tell(userdata(1, part, b"\xff\x09" + struct.pack(">H", len(entries)) + entries))
    talk.close()
    assert len(talk.said()) == facts_told


def test_a_refusal_and_a_question_say_nothing() -> None:
    talk = told()
    talk.ask(userdata(1, head(1, 4, 1), b"\xff\x09\x00\x04\x00\x11\x00\x00"))
    talk.tell(userdata(1, head(2, 4, 1, 0, 0xD401), b"\x0a\x00\x00\x00"))
    talk.ask(userdata(2, head(1, 4, 1), b"\xff\x09\x00\x04\x00\x11\x00\x00"))
    talk.close()
    assert talk.facts == []


def test_a_clock_that_is_read_and_one_that_is_set() -> None:
    talk = told()
    seconds = int(START_NS // 10**9)
    clock = "0019" + "20091312264500" + "01"  # 2020-09-13 12:26:45.000
    answered(talk, 1, 7, 1, b"", bytes.fromhex(clock))
    at_ns = talk.now_ns
    (fact,) = talk.facts
    assert int(fact.value) == (seconds + 5) * 10**9 - at_ns
    assert (fact.key, fact.source) == (facts.CLOCK, "read clock")
    talk.ask(userdata(2, head(1, 7, 2), b"\xff\x09\x00\x0a" + bytes.fromhex(clock)))
    asked_ns = talk.now_ns
    talk.tell(userdata(2, head(2, 7, 2, 0, 0), b"\x0a\x00\x00\x00"))
    set_ = talk.facts[1]
    assert (set_.key, int(set_.value), set_.source) == (facts.CLOCK_SET, (seconds + 5) * 10**9 - asked_ns, "set clock")
    assert (set_.time_ns, set_.frames) == (asked_ns, [fact.frames[-1] + 1])


@pytest.mark.parametrize("text", ["", "DT#2020-02-30-00:00:00.000", "no time", "DT#2020-01-01"])
def test_what_is_no_time(text: str) -> None:
    assert clock_time(text) is None


def test_blocks() -> None:
    talk = told()
    answered(talk, 1, 3, 1, b"", b"08\x00\x02" + b"0A\x00\x07")
    answered(talk, 2, 3, 2, b"0A", struct.pack(">HBBHBB", 1, 0x22, 5, 9, 0x22, 5))
    answered(talk, 3, 3, 2, b"08", struct.pack(">HBB", 1, 0x22, 1))
    assert talk.said() == [
        ("blocks OB", "2"),
        ("blocks DB", "7"),
        ("block", "DB 1"),
        ("block", "DB 9"),
        ("block", "OB 1"),
    ]


def test_a_mode_transition_is_said_unasked() -> None:
    talk = told()
    frame = talk.tell(events.mode(0))
    (fact,) = talk.facts
    assert (fact.host, fact.key, fact.value, fact.frames) == ("10.0.0.2", facts.OPERATING_MODE, "STOP", [frame])


def test_a_session_of_s7comm_plus() -> None:
    talk = Told()
    begun(talk)
    opened(talk)
    assert talk.said() == [(facts.ORDER_NUMBER, "6ES7 215-1AG40-0XB0"), (facts.FIRMWARE, "V4.3")]
    assert {fact.source for fact in talk.facts} == {"S7comm-plus session"}


def test_an_identification_record() -> None:
    record = bytes.fromhex("002000380100002a") + b"6ES7 511-1AK01-0AB0 " + b"S C-X123".ljust(16) + b"\0\3V\2\5\1"
    session = PlusSession(Program(), Identity())
    session.identified(record.ljust(60, b"\0"))
    assert [(key, value) for key, value, _ in session.identity.told] == [
        (facts.ORDER_NUMBER, "6ES7 511-1AK01-0AB0"),
        (facts.SERIAL_NUMBER, "S C-X123"),
        (facts.HARDWARE, "3"),
        (facts.FIRMWARE, "V2.5.1"),
    ]


def test_network_cards() -> None:
    talk = Told()
    talk.macs = [bytes.fromhex("001b1b000001"), bytes.fromhex("001b1b000002")]
    talk.open()
    assert [(fact.host, fact.value) for fact in talk.facts] == [
        ("10.0.0.1", "00:1b:1b:00:00:01"),
        ("10.0.0.2", "00:1b:1b:00:00:02"),
    ]
    bare = told()
    bare.close()
    assert bare.facts == []  # no card has an address of zeros


def test_an_old_answer_is_not_read_again_but_said_again() -> None:
    talk = told()
    for number in range(3):
        szl(talk, number + 1, mode(8))
    assert [fact.fresh for fact in talk.facts] == [True, False, False]


CLOCK: Final = bytes.fromhex("0019" + "20091312264500" + "01")
#: What was asked and told, and what of it is a fact of the station whichever request the answer belongs to.
DOUBTFUL: Final = [
    (4, 1, identification(ORDER, (3, 2, 6))[:4], identification(ORDER, (3, 2, 6)), True),
    (7, 1, b"", CLOCK, True),
    (7, 2, CLOCK, b"", False),
    (3, 1, b"", b"08\x00\x02", True),
    (3, 2, b"0A", struct.pack(">HBB", 1, 0x22, 5), False),
]


@each(("group", "subfunction", "asked", "answer", "stays"), DOUBTFUL)
def test_of_a_pair_that_is_only_likely_only_what_the_answer_itself_says_is_a_fact(
    group: int, subfunction: int, asked: bytes, answer: bytes, stays: bool
) -> None:
    talk = told()
    answered(talk, 1, group, subfunction, asked, answer)
    transaction = talk.transactions[-1]
    sure = Evidence().of_transaction(transaction)
    assert sure
    transaction._flags |= GAPS
    assert len(Evidence().of_transaction(transaction)) == (len(sure) if stays else 0)
