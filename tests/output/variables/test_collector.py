"""Items → values of variables: who, how, what before; refusals are none; places are joined from items that overlap."""

from __future__ import annotations

import json
import random
import struct
from fractions import Fraction
from pathlib import Path
from typing import Any, Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

import dissect
from dissect.engine.pipeline import Options, Pipeline
from dissect.engine.transactions.results import ALIKE, GAPS
from dissect.engine.transactions.transaction import ANSWERED, Transaction
from dissect.meaning.tags import load_tags
from dissect.output.variables.choosing import Known, choose
from dissect.output.variables.collector import ValueCollector, item_type
from dissect.output.variables.model import Variable
from dissect.output.variables.summary import Summary, csv_rows, mean_text, variable_json
from dissect.output.variables.writers import line_end, shown
from dissect.packets.tcp.stream import Endpoint
from dissect.protocols.s7plus.contents import VariableAddress
from dissect.protocols.s7plus.objects import build_object
from dissect.protocols.s7plus.tables import EXPLORE
from dissect.protocols.s7plus.value_showing import as_json, members_said
from dissect.protocols.s7plus.value_tables import DINT, STRUCT, UDINT, WSTRING
from dissect.protocols.s7plus.value_tables import INT as PLUS_INT
from dissect.protocols.s7plus.value_tables import REAL as PLUS_REAL
from dissect.protocols.s7plus.values import Struct, Value
from dissect.wire.text import Clock
from tests.engine.transactions import talk as line
from tests.engine.transactions.test_results import PUSH as PUSHED
from tests.engine.transactions.test_results import RESPONSE, TRANSFER, sent, subscribe
from tests.meaning.report.schemas import complaints
from tests.meaning.report.support import ROOT, Kept, begun, observed
from tests.output.variables.support import BIT, BYTE, INT, REAL, WORD, collected, db, reads, real, rows_of, said, writes
from tests.properties.messages import Item, dt
from tests.protocols.s7plus import bodies
from tests.protocols.s7plus.pdus import asked, framed, told
from tests.protocols.s7plus.test_program import type_of, variable

CRAFTED: Final = ROOT / "captures" / "crafted"
SCD: Final = ROOT / "captures" / "scd"


def test_a_read_and_a_write_are_values_of_one_variable() -> None:
    talk = begun()
    level = db(REAL, 4)
    reads(talk, 1, (level, real(3.5)))
    writes(talk, 2, (level, real(4.5), 0xFF))
    reads(talk, 3, (level, real(4.5)))
    first, second, third = rows_of(talk)
    assert said([first, second, third]) == [
        ("read", "DB1.DBD4", "REAL", 3.5),
        ("write", "DB1.DBD4", "REAL", 4.5),
        ("read", "DB1.DBD4", "REAL", 4.5),
    ]
    assert [(row.first, row.changed, row.previous) for row in (first, second, third)] == [
        (True, True, None), (False, True, 3.5), (False, False, 4.5),
    ]  # fmt: skip
    # A read is where its answer is, a write where its request is: packets 8, 9 and 10, 11 behind the handshakes.
    assert [int(row.frame) for row in (first, second, third)] == [9, 10, 13]
    packets = talk.packets()
    assert [int(row.time_ns) for row in (first, second, third)] == [packets[at - 1].time_ns for at in (9, 10, 13)]
    assert first.host == first.link.client.host
    assert first.variable is third.variable
    assert [row.writes for row in (first, second, third)] == [False, True, False]
    assert (first.data, first.connection, str(first.plc).rpartition(":")[2]) == (real(3.5), 1, "102")


def test_what_is_refused_or_unanswered_is_no_value_but_counted() -> None:
    talk = begun()
    level, pump = db(REAL, 4), db(BIT, 8)
    reads(talk, 1, (level, real(3.5)), (pump, 0x0A))
    writes(talk, 2, (level, real(9.0), 0x05), (pump, b"\x01", 0xFF))
    writes(talk, 3, (level, real(8.0), 0x05))
    reads(talk, 4, (level, real(3.5)))
    talk.send(0, line.dt(line.write(5, [line.item(0x84, 1, 32, REAL)], line.written(7, real(7.0)))))  # nobody answers
    found = collected(ValueCollector(), talk.packets())
    assert said(found.take()) == [
        ("read", "DB1.DBD4", "REAL", 3.5),
        ("write", "DB1.DBX8.0", "BOOL", True),
        ("read", "DB1.DBD4", "REAL", 3.5),
    ]
    assert [(one.address, one.refused_reads, one.refused_writes, one.unconfirmed) for one in found.variables] == [
        ("DB1.DBD4", 0, 2, 1), ("DB1.DBX8.0", 1, 0, 0),
    ]  # fmt: skip
    assert (found.refused, found.unconfirmed) == (3, 1)


def test_a_request_that_is_refused_as_a_whole_counts_for_each_of_its_items() -> None:
    talk = line.Talk()
    talk.open()
    talk.ask(line.read(1, line.dbw(10, 4), line.dbw(10, 8)))
    talk.tell(line.ack_data(1, b"\x04\x00", code=0x8500))
    talk.close()
    found = ValueCollector()
    for transaction in talk.transactions:
        found.transaction(transaction)
    assert found.take() == []
    assert [one.refused_reads for one in found.variables] == [1, 1]


def test_only_changes_and_only_so_often() -> None:
    talk = begun()
    for ref, value in enumerate((1.0, 1.0, 2.0, 2.0, 1.0), 1):
        reads(talk, ref, (db(REAL, 0), real(value)))
    assert [row.value for row in rows_of(talk)] == [1.0, 1.0, 2.0, 2.0, 1.0]
    assert [(row.value, row.previous) for row in rows_of(talk, changes=True)] == [(1.0, None), (2.0, 1.0), (1.0, 2.0)]
    times = [row.time_ns for row in rows_of(talk)]
    every = 2 * (times[1] - times[0])
    thinned = rows_of(talk, every_ns=every)
    kept: list[int] = []
    for row in rows_of(talk):
        if not kept or row.time_ns // every != kept[-1] // every:
            kept.append(row.time_ns)
    assert [row.time_ns for row in thinned] == kept
    assert len(kept) < 5
    # What is left out is as if it had not been: the value before is the one of the row before.
    assert [row.previous for row in thinned] == [None, *[row.value for row in thinned[:-1]]]


def test_a_place_within_an_item_is_found_with_its_type() -> None:
    """DBD4 inside a read of DBB0 x10, typed as asked; a bit of it as well."""
    talk = begun()
    content = bytes(range(4)) + real(80.5) + b"\x81\x02"
    reads(talk, 1, (db(BYTE, 0, 10), content))
    assert said(rows_of(talk, "DB1.DBD4:REAL", "DB1.DBX8.7", "DB1.DBW8", "DB1,INT8", "DB2.DBD4", "MW4")) == [
        ("read", "DB1.DBD4", "REAL", 80.5),
        ("read", "DB1.DBW8", "WORD", 0x8102),
        ("read", "DB1.DBW8", "INT", 0x8102 - 0x10000),
        ("read", "DB1.DBX8.7", "BOOL", True),
    ]
    assert said(rows_of(talk, "DB1.DBB2 x3")) == [("read", "DB1.DBB2", "3 x BYTE", [2, 3, 0x42])]


def test_a_place_takes_the_type_of_an_item_that_is_exactly_it() -> None:
    talk = begun()
    reads(talk, 1, (db(REAL, 4), real(2.5)))
    reads(talk, 2, (db(BYTE, 0, 10), bytes(4) + real(3.5) + bytes(2)))
    assert said(rows_of(talk, "DB1.DBD4")) == [("read", "DB1.DBD4", "REAL", 2.5), ("read", "DB1.DBD4", "REAL", 3.5)]


def test_parts_of_a_place_are_put_together() -> None:
    """Until all of its bytes were seen, an item that touches it stands for itself."""
    talk = begun()
    writes(talk, 1, (db(WORD, 4), b"\x42\xa1", 0xFF))
    reads(talk, 2, (db(WORD, 6), b"\x00\x00"))
    writes(talk, 3, (db(WORD, 6), b"\x80\x00", 0xFF))
    writes(talk, 4, (db(BIT, 7, bit=0), b"\x01", 0xFF))
    writes(talk, 5, (db(WORD, 6), b"\xff\xff", 0x0A))
    rows = rows_of(talk, "DB1.DBD4:REAL")
    assert said(rows) == [
        ("write", "DB1.DBW4", "WORD", 0x42A1),
        ("read", "DB1.DBD4", "REAL", 80.5),
        ("write", "DB1.DBD4", "REAL", 80.75),
        ("write", "DB1.DBD4", "REAL", 80.75001),
    ]
    assert [row.pieced for row in rows] == [False, True, True, True]
    assert [row.previous for row in rows] == [None, None, 80.5, 80.75]


@pytest.mark.parametrize("seed", range(3))
def test_joined_items_say_what_a_memory_says(seed: int) -> None:
    """Random reads and writes of a block beside a simple memory: each place asked for has what the memory has then."""
    roll = random.Random(seed)
    memory = bytearray(roll.randbytes(24))
    talk = begun()
    expected: list[object] = []
    known = [False] * 32
    for ref in range(1, 120):
        size, octets = roll.choice(((BYTE, 1), (WORD, 2), (REAL, 4)))
        length = roll.randrange(1, 5)
        total = octets * length
        octet = roll.randrange(0, 24 - total + 1)
        item = db(size, octet, length)
        if roll.random() < 0.5:
            content = roll.randbytes(total)
            code = 0xFF if roll.random() < 0.8 else 0x05
            writes(talk, ref, (item, content, code))
            if code == 0xFF:
                memory[octet : octet + total] = content
        else:
            code = 0xFF
            reads(talk, ref, (item, bytes(memory[octet : octet + total])))
        if code == 0xFF and octet < 12 and octet + total > 8:
            for at in range(octet, octet + total):
                known[at] = True
            if all(known[8:12]):
                expected.append(struct.unpack_from(">i", memory, 8)[0])
    rows = [row for row in rows_of(talk, "DB1,DI8") if row.address == "DB1.DBD8"]
    assert [row.value for row in rows] == expected
    assert len(expected) > 10


def test_a_value_that_does_not_decode_has_its_bytes() -> None:
    talk = begun()
    reads(talk, 1, (db(INT, 0, 2), b"\x00\x01\xff\xff"))
    reads(talk, 2, (db(BYTE, 9, 4), b"\x01\x02"))  # less than was asked for
    rows = rows_of(talk)
    assert [(row.value, row.data) for row in rows] == [([1, -1], b"\x00\x01\xff\xff"), (None, b"\x01\x02")]


def test_pushes_and_what_a_variable_table_modifies_and_forces() -> None:
    rows = list(dissect.values(CRAFTED / "coverage-userdata.pcapng"))
    assert ("modify", "MW6", "WORD", 4660) in said(rows)
    assert ("force", "DB10.DBW4", "5 x WORD", [1, 2, 3, 4, 5]) in said(rows)
    assert ("push", "MB0", "6 x BYTE", [0x41, 0x33, 0x85, 0x1F, 0xDE, 0xAD]) in said(rows)
    # The second item of the force was refused, so it is none of the values.
    assert [row.address for row in rows if row.how == "force"] == ["DB10.DBW4"]
    assert {row.writes for row in rows if row.how in {"modify", "force"}} == {True}


def test_s7comm_plus_reads_and_notifications() -> None:
    path = CRAFTED / "plus-plant.pcapng"
    level = list(dissect.values(path, of='DB1."level"'))
    assert [(row.how, row.type, row.value) for row in level] == [
        ("notification", "Real", value) for value in (42.5, 42.5, 43.5, 44.5, 45.5)
    ]
    rows = list(dissect.values(path))
    assert ("read", 'DB1."setpoint"', "Int", 60) in said(rows)
    assert ("write", "CPUexecUnit.OperatingStateREQ", "DInt", 1) in said(rows)
    stop = next(row for row in rows if row.address == "CPUexecUnit.OperatingStateREQ")
    assert (stop.text, line_end(stop, "state")) == ("STOP", "state = 1 (STOP)")
    assert not [row for row in rows if "Session" in row.address]  # what a session keeps for itself is no variable


def test_members_have_their_names_and_what_their_numbers_mean() -> None:
    inner = Value(0, STRUCT, Struct(4055, [(4059, Value(0, UDINT, 1))]))
    value = Value(0, STRUCT, Struct(3481, [(3486, Value(0, DINT, 8)), (3487, Value(0, WSTRING, "x")), (9999, inner)]))
    told = as_json(value)
    assert isinstance(told, dict)
    assert members_said(told["members"]) == '{OperatingState: 8 RUN, ComponentDiagnostics: "x", 9999: {Slot: 1}}'
    assert members_said({"tank": {"level": 1.5, "full": True}}) == "{tank: {level: 1.5, full: true}}"
    assert members_said({"name": "Öl", "old": [None, {"x": 1}]}) == '{name: "Öl", old: [null, {x: 1}]}'
    assert members_said({"level": 1.5, "3486": [8]}) == "{level: 1.5, OperatingState: [8]}"


def test_octets_of_s7comm_plus_are_shown_as_such() -> None:
    blob = Variable(Endpoint(bytes(4), 102), 0, "CPUproxy.3753", "Blob", "", "")
    assert shown(blob, "0a14", None) == "0a 14"
    assert shown(blob, "", None) == "(empty)"
    assert shown(blob, "no octets", None) == "'no octets'"


def test_a_value_of_s7comm_plus_that_contradicts_its_declaration() -> None:
    """The row and its line say so beside the bytes, at the address without its name."""
    address = VariableAddress(0, 0x8A0E0001, 2550, [14])
    talk = begun()
    kind = type_of(0x92000001, ("level", variable(14, 5)))
    block = bodies.rid(address.area)
    talk.send(0, dt(framed(asked(1, EXPLORE, body=block + b"\0\1\1\0\0\0" + bodies.end(1) + b"\0"), 3)))
    answer = b"\0" + block + bodies.number(2) + build_object(kind) + bodies.FILL
    talk.send(1, dt(framed(told(1, EXPLORE, answer), 3)))
    for number, value in ((2, Value(0, PLUS_INT, 5)), (3, Value(0, PLUS_REAL, 1.5))):
        talk.send(0, dt(framed(asked(number, body=bodies.get_multi(address)))))
        talk.send(1, dt(framed(told(number, body=bodies.multi_got([(1, value)], [])))))
    rows = rows_of(talk)
    assert [(row.address, row.value, row.remark) for row in rows] == [
        ('DB1."level"', 5, ""),
        ("DB1 LID 14", None, 'declared Int, sent as Real; its address is that of DB1."level"'),
    ]
    assert line_end(rows[0], "level") == "level = 5"
    said = 'declared Int, sent as Real; its address is that of DB1."level"'
    assert line_end(rows[1], "level") == f"level = 3f c0 00 00  [{said}]"


def test_scd_reads_writes_and_pdos() -> None:
    rows = list(dissect.values(SCD / "plant.pcapng", scd=SCD / "plant.toml", bind=SCD / "plant.bind.toml"))
    flow = [row for row in rows if row.address == "0x6044:0" and row.how == "pdo" and row.plc.port == 5600]
    assert [row.value for row in flow][:3] == [1200, 1193, 1186]
    assert {row.tag for row in flow} == {"Расход 1"}
    assert {row.writes for row in flow} == {False}
    command = [row for row in rows if row.address == "0x6000:4" and row.writes and row.how == "pdo"]
    assert [(row.value, row.host) for row in command] == [(1500, "192.0.2.10")] * 3
    pressure = [row for row in rows if row.tag == "Давление 1"]
    assert pressure
    assert not [row for row in pressure if row.how == "write"]  # read-only: the write was refused
    told = list(
        dissect.values(SCD / "plant.pcapng", of="0x6044:0", scd=SCD / "plant.toml", bind=SCD / "plant.bind.toml")
    )
    assert {row.address for row in told} == {"0x6044:0"}


def test_no_more_variables_than_the_limit_are_remembered() -> None:
    talk = begun()
    for ref in range(1, 9):
        reads(talk, ref, (db(WORD, 2 * (ref % 4)), bytes((0, ref))))
    found = collected(ValueCollector(most=2), talk.packets())
    rows = found.take()
    assert [(row.value, row.previous) for row in rows] == [  # all are there; the first two variables are remembered
        (1, None), (2, None), (3, None), (4, None), (5, 1), (6, 2), (7, None), (8, None),
    ]  # fmt: skip
    assert len(found.variables) == 2
    assert found.untracked == 4


def test_the_rows_of_a_capture_are_the_items_that_were_not_refused(corpus: Path) -> None:
    """Every capture at hand: the rows equal the items of its transactions, address, value, octets, packet."""
    seen = 0
    for path in sorted([*CRAFTED.glob("*.pcap*"), *(ROOT / "captures").glob("*.pcapng"), *corpus.glob("*.pcap*")]):
        try:
            expected = [row for event in dissect.open(path, pdus=False) for row in items_of(event)]
            rows = [
                (row.how, row.address, row.type, row.value, row.data, int(row.frame))
                for row in dissect.values(path)
                if row.how in {"read", "write"} and row.link.protocol != "s7comm_plus"
            ]
        except dissect.CaptureError:
            continue
        assert rows == expected, path
        seen += len(rows)
    assert seen > 1000


def items_of(event: Any) -> list[tuple[object, ...]]:
    """Return the items of a transaction that carry a value."""
    if not isinstance(event, Transaction) or event.function not in {4, 5} or event.is_plus or event.is_scd:
        return []
    if event.outcome != "answered" or event.rosctr != 1 or event.is_likely:
        return []
    wrote = event.function == 5
    frame = int(event.request_frame if wrote else event.response_frame)
    return [
        ("write" if wrote else "read", one.item.address, item_type(one.item), one.value, one.data, frame)
        for one in event.s7_results
        if one.item is not None and one.return_code == 0xFF and one.data is not None
    ]


def test_tags_name_what_items_cover(tmp_path: Path) -> None:
    tags = tmp_path / "tank.csv"
    tags.write_text(
        "address,type,name,unit,scale\nDB1.DBD0,REAL,Tank.Level,m,\nDB1.DBX4.0,BOOL,Tank.Pump,,\nDB1.DBW6,INT,Tank.Temp,°C,0.1\n",
        encoding="utf-8",
    )
    talk = begun()
    reads(talk, 1, (db(BYTE, 0, 10), struct.pack(">fBBhh", 3.5, 1, 9, 215, 7)))
    reads(talk, 2, (db(BYTE, 0, 2), b"\x40\x60"))
    reads(talk, 3, (db(WORD, 6), b"\x00\xd8"))
    options = Options(strict=True, naming=load_tags([tags]).naming())
    rows = collected(ValueCollector(), talk.packets(), options).take()
    assert [
        (row.name, row.type, row.value, row.unit, row.previous) for row in rows if row.tag and row.value is not None
    ] == [
        ("Tank.Level", "REAL", 3.5, "m", None),
        ("Tank.Pump", "BOOL", True, "", None),
        ("Tank.Temp", "INT", 21.5, "°C", None),
        ("Tank.Temp", "INT", 21.6, "°C", 21.5),
    ]
    assert [(row.name, row.data, row.remark) for row in rows if row.value is None] == [
        ("Tank.Level", b"\x40\x60", "bytes 0 to 1 of 4"),
    ]
    assert [(row.type, row.value) for row in rows if not row.tag] == [("BYTE", 9), ("2 x BYTE", [0, 7])]
    assert [line_end(row, row.address) for row in rows if not row.tag] == ["DB1.DBB5 = 9", "DB1.DBB8 = 00 07"]


def test_a_bit_changes_by_itself(tmp_path: Path) -> None:
    """Its neighbours in the byte are no change of it."""
    tags = tmp_path / "bits.csv"
    tags.write_text(
        "address,type,name\nDB1.DBX0.1,BOOL,Pump\nDB1.DBX1.0,Array[0..3] of BOOL,Valves\n", encoding="utf-8"
    )
    talk = begun()
    for ref, octets in enumerate((b"\x02\x01", b"\x83\xf1", b"\x80\xf3"), 1):
        reads(talk, ref, (db(BYTE, 0, 2), octets))
    rows = collected(ValueCollector(), talk.packets(), Options(strict=True, naming=load_tags([tags]).naming())).take()
    assert [(row.value, row.changed) for row in rows if row.tag == "Pump"] == [
        (True, True),
        (True, False),
        (False, True),
    ]
    valves = [True, False, False, False]
    assert [(row.value, row.changed, row.data) for row in rows if row.tag == "Valves"] == [
        (valves, True, b"\1\0\0\0"), (valves, False, b"\1\0\0\0"), ([True, True, False, False], True, b"\1\1\0\0"),
    ]  # fmt: skip


def test_bytes_are_named_and_written_alike_however_they_are_asked_for() -> None:
    """Four bytes that are written where others read a double word: their own address and type, in hexadecimal."""
    talk = begun()
    writes(talk, 1, (Item(BYTE, 4, 0, 0x83, 64), bytes.fromhex("42340000"), 0xFF))
    for names in ((), ("MD8",)):
        (row,) = rows_of(talk, *names)
        assert (row.address, row.type) == ("MB8", "4 x BYTE")
        assert shown(row.variable, row.value, row.data) == "42 34 00 00"
    assert said(rows_of(talk, "MB8")) == [("write", "MB8", "BYTE", 0x42)]


@given(st.lists(st.integers(-(2**63), 2**63 - 1) | st.floats(-1e30, 1e30), min_size=1, max_size=20))
def test_a_mean_is_between_the_extremes_as_they_are_written(numbers: list[float]) -> None:
    least, most = min(numbers), max(numbers)
    mean = sum(Fraction(number) for number in numbers) / len(numbers)
    text = mean_text(float(mean), least, most)
    assert least <= (int(text) if text.lstrip("-").isdigit() else float(text)) <= most


def test_a_mean_has_no_exponent_where_its_numbers_have_none() -> None:
    assert mean_text(4242442424.0, 4242442424, 4242442424) == "4242442424"
    assert mean_text(2.5, 1, 4) == "2.5"
    assert mean_text(44.333333333333336, 40.0, 45.0) == "44.3333333"


def test_the_same_address_in_another_vlan_is_another_plc() -> None:
    """Two machines that are alike, each with a value of its own: neither changes because of the other."""
    collector = ValueCollector(changes=True)
    first = line.Talk()
    first.pipeline = Pipeline(collector, Options(strict=True))
    for number, (vlan, value) in enumerate(((10, 5), (20, 5), (10, 5), (20, 6))):
        talk = first if not number else line.Talk(50000 + number, beside=first)
        talk.vlan = vlan
        talk.open()
        talk.ask(line.read(1, line.dbw(1, 0)))
        talk.tell(line.words(1, value))
    first.finish()
    rows = collector.take()
    assert [(row.variable.vlan, row.value, row.first, row.previous) for row in rows] == [
        (10, 5, True, None), (20, 5, True, None), (20, 6, False, 5),
    ]  # fmt: skip
    assert rows[1].variable is rows[2].variable
    assert rows[0].variable is not rows[1].variable


# ---- pairs that are only likely -------------------------------------------------------------------------------------


def doubtful(collector: ValueCollector, talk: Any, *numbers: int, flag: int = GAPS) -> list[Any]:
    """Give a collector the transactions of a talk, those of these numbers as pairs that are only likely; return its rows."""
    kept = Kept()
    observed(kept, talk.packets())
    for transaction in kept.transactions:
        if transaction.number in numbers:
            transaction._flags |= flag
        collector.transaction(transaction)
    return collector.take()


def thrice() -> Any:
    talk = begun()
    for ref, value in ((1, 7), (2, 8), (3, 7)):
        reads(talk, ref, (db(WORD, 0), bytes((0, value))))
    return talk


@pytest.mark.parametrize("flag", [GAPS, ALIKE])
def test_a_value_that_is_only_likely_is_left_out_or_marked_and_never_remembered(flag: int) -> None:
    left = ValueCollector()
    rows = doubtful(left, thrice(), 3, flag=flag)
    assert [(row.value, row.previous, row.changed) for row in rows] == [(7, None, True), (7, 7, False)]
    assert left.doubts == {"gaps" if flag == GAPS else "alike": 1}
    marked = ValueCollector(likely=True)
    rows = doubtful(marked, thrice(), 3, flag=flag)
    assert [(row.value, row.previous, row.changed, bool(row.doubt)) for row in rows] == [
        (7, None, True, False), (8, 7, True, True), (7, 7, False, False),
    ]  # fmt: skip
    assert marked.doubts == {}


def test_a_push_whose_items_are_only_likely_is_left_out_or_marked() -> None:
    talk = begun()
    talk.send(0, dt(subscribe(1, TRANSFER, line.dbw(1, 0))))
    talk.send(1, dt(sent(RESPONSE, TRANSFER, 1, b"\xff\x04\x00\x10\x00\x07", reference=1)))
    for octet in b"\x08\x09":
        talk.send(1, dt(sent(PUSHED, TRANSFER, 1, b"\xff\x04\x00\x10\x00" + bytes((octet,)))))
    left, marked = ValueCollector(), ValueCollector(likely=True)
    assert [(row.value, row.previous) for row in doubtful(left, talk, 3)] == [(7, None), (9, 7)]
    assert left.doubts == {"gaps": 1}
    rows = doubtful(marked, talk, 3)
    assert [(row.value, row.previous, row.certainty) for row in rows] == [
        (7, None, "sure"), (8, 7, "likely"), (9, 7, "sure"),
    ]  # fmt: skip


def test_one_that_is_only_likely_takes_no_interval_and_is_no_change() -> None:
    first = 2  # the first read of all, behind the setup
    rows = doubtful(ValueCollector(every_ns=3_600_000_000_000, likely=True), thrice(), first)
    assert [(row.value, bool(row.doubt)) for row in rows] == [(7, True), (8, False)]
    rows = doubtful(ValueCollector(changes=True, likely=True), thrice(), 3)
    assert [(row.value, row.previous, bool(row.doubt)) for row in rows] == [(7, None, False), (8, 7, True)]


def test_a_place_is_not_put_together_from_what_is_only_likely() -> None:
    talk = begun()
    reads(talk, 1, (db(BYTE, 0, 2), b"\x01\x02"))
    reads(talk, 2, (db(BYTE, 1, 2), b"\x09\x09"))  # the second octet of the place, and one behind it
    reads(talk, 3, (db(BYTE, 0), b"\x05"))
    wanted = choose(["DB1.DBW0"], Known(None))
    rows = doubtful(ValueCollector(wanted, likely=True), talk, 3)
    assert [(row.data, bool(row.doubt)) for row in rows] == [
        (b"\x01\x02", False),
        (b"\x01\x09", True),
        (b"\x05\x02", False),
    ]
    assert [row.data for row in doubtful(ValueCollector(wanted), talk, 3)] == [b"\x01\x02", b"\x05\x02"]


def test_a_summary_counts_what_is_only_likely_apart() -> None:
    talk = begun()
    reads(talk, 1, (db(WORD, 0), b"\0\7"))
    reads(talk, 2, (db(WORD, 0), b"\1\0"))
    reads(talk, 3, (db(WORD, 0), 0x0A))
    writes(talk, 4, (db(WORD, 2), b"\0\1", 0xFF))
    collector = ValueCollector(sums=True)
    doubtful(collector, talk, 3, 4, 5)
    assert (collector.refused, collector.unconfirmed, collector.doubts) == (0, 0, {"gaps": 3})
    word, other = Summary(collector).variables
    told = variable_json(word, Clock())
    assert (told["count"], told["max"], told["refused_reads"], told["likely"]) == (1, 7, 0, 2)
    assert complaints("variable", json.loads(json.dumps(told)), exact=True) == []
    assert (variable_json(other, Clock())["count"], other.likely) == (0, 1)
    heads, *rows = csv_rows(Summary(collector))
    assert [row[heads.index("likely")] for row in rows] == ["2", "1"]


def test_values_of_s7comm_plus_that_are_only_likely() -> None:
    path = CRAFTED / "plus-plant.pcapng"
    kept = [event for event in dissect.open(path, pdus=False) if isinstance(event, Transaction)]
    plain, none, all_of_them = ValueCollector(), ValueCollector(), ValueCollector(likely=True)
    for transaction in kept:
        plain.transaction(transaction)
        if transaction._outcome == ANSWERED:
            transaction._flags |= GAPS
        none.transaction(transaction)
        all_of_them.transaction(transaction)
    pairs = [row for row in plain.take() if row.how in {"read", "write"}]
    assert pairs
    assert [row for row in none.take() if row.how in {"read", "write"}] == []
    assert len([row for row in all_of_them.take() if row.doubt]) == len(pairs)
