"""What is compared: the fields of the layouts, under names that Wireshark knows."""

from __future__ import annotations

import subprocess

from dissect.protocols.iso import layouts as iso
from dissect.protocols.s7 import clock
from dissect.protocols.s7 import layouts as s7
from dissect.testing.oracle import facts
from dissect.testing.oracle.facts import (
    BODY_NAMES,
    IN_BODY,
    IN_DATA_ITEM,
    IN_HEADER,
    IN_ITEM,
    IN_PARAMETERS,
    IN_TPDU,
    IN_TPKT,
    NAMES,
    PDU,
    FieldPlace,
    LocatedValue,
    Record,
    layouts,
)
from dissect.wire import part
from dissect.wire.layout import Layout

LAYOUTS = [value for module in (iso, s7) for value in vars(module).values() if isinstance(value, Layout)]


def test_every_named_field_of_a_layout_is_compared() -> None:
    named = {field.wireshark for layout in LAYOUTS for field in layout.fields if field.wireshark}
    assert named <= frozenset().union(*NAMES.values()) | BODY_NAMES
    assert len(named) > 45


def test_every_layout_of_a_body_is_found() -> None:
    """Those that stand in a variable of their own and those that stand in a table only."""
    found = layouts()
    assert all(any(one is layout for one in found) for layout in (clock.CLOCK, s7.SETUP, part.FILL))
    assert {"s7comm.data.ts_reserved", "s7comm.data.ts_year1"} <= BODY_NAMES
    assert all(field.wireshark in BODY_NAMES or not field.wireshark for layout in found for field in layout.fields)


def test_layouts_in_tables_are_found() -> None:
    one, two, three = (Layout(name, "here", []) for name in "123")
    assert list(facts._layouts_in({1: [one, (two, {"x": three})], 2: "text"})) == [one, two, three]


def test_wireshark_has_every_name() -> None:
    text = subprocess.run(["tshark", "-G", "fields"], capture_output=True, check=True).stdout.decode("utf-8", "replace")
    fields = {line.split("\t")[2] for line in text.splitlines() if line.startswith("F\t")}
    assert {name for names in (*NAMES.values(), BODY_NAMES) for name in names} - fields == set()


def test_names_stand_where_they_belong() -> None:
    assert "tpkt.length" in NAMES[IN_TPKT]
    assert {"cotp.cause", "cotp.reject_cause", "cotp.src-tsap-bytes"} <= NAMES[IN_TPDU]
    assert "s7comm.header.errcod" in NAMES[IN_HEADER]
    assert {"s7comm.param.itemcount", "s7comm.param.pdu_length", "s7comm.param.userdata.seq_num"} <= NAMES[
        IN_PARAMETERS
    ]
    assert "s7comm.param.item.address" in NAMES[IN_ITEM]
    assert {"s7comm.data.returncode", "s7comm.resp.data"} <= NAMES[IN_DATA_ITEM]


def test_a_place_reads_well() -> None:
    assert str(FieldPlace(IN_ITEM, 3, "s7comm.param.item.db")) == "s7comm.param.item.db of item 3"
    assert str(FieldPlace(IN_BODY, 23, "s7comm.data.ts")) == "s7comm.data.ts at byte 23"
    assert str(FieldPlace(IN_HEADER, 0, "s7comm.header.pduref")) == "s7comm.header.pduref"


def test_a_record_gives_its_values() -> None:
    record = Record(PDU, 1, b"2", {FieldPlace(IN_ITEM, 2, "s7comm.param.item.db"): LocatedValue(7, 30)})
    assert record.value(IN_ITEM, "s7comm.param.item.db", 2) == 7
    assert record.value(IN_ITEM, "s7comm.param.item.db", 1) is None
    assert record.value(IN_ITEM, "s7comm.param.item.area", 2) is None
