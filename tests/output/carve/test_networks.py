"""Bodies of S7-1200/1500 blocks: ladder as lines, SCL as its source, names, comparison, hostile XML."""

from __future__ import annotations

import zlib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dissect.engine.program.carved import CarvedBlock, plus_block
from dissect.engine.program.compare import compare
from dissect.meaning.report.words import Places
from dissect.output.carve.code import CodeListing, References, details_of
from dissect.output.carve.networks import PlusNetwork, compare_networks, interface, networks
from dissect.protocols.s7plus.objects import Attribute, PlusObject, build_object
from dissect.protocols.s7plus.value_tables import BLOB, SPARSE_ARRAY
from dissect.protocols.s7plus.values import Blob, Value
from dissect.wire.text import Clock
from tests.meaning.report.schemas import complaints

pytest.importorskip("defusedxml")

LADDER = """<Network Lang="LAD" NetPos="1"><FlgNet><Parts>
<Part UId="1" Gate="Contact"/><Part UId="2" Gate="Contact"><Negated PinName="operand"/></Part><Part UId="3" Gate="O"/>
<Part UId="4" Gate="SCoil"/><Part UId="5" Gate="Mul"/><Part UId="6" Gate="Move"/>
<ORef UId="11" RefId="1"/><ORef UId="12" RefId="2"/><ORef UId="13" RefId="3"/><ORef UId="14" RefId="9"/>
</Parts><Wires>
<Wire><Powerrail/><PCon UId="1" PinName="in"/><PCon UId="2" PinName="in"/><PCon UId="5" PinName="en"/></Wire>
<Wire><OCon UId="11"/><PCon UId="1" PinName="operand"/></Wire><Wire><OCon UId="12"/><PCon UId="2" PinName="operand"/></Wire>
<Wire><PCon UId="1" PinName="out"/><PCon UId="3" PinName="IN1"/></Wire>
<Wire><PCon UId="2" PinName="out"/><PCon UId="3" PinName="IN2"/></Wire>
<Wire><PCon UId="3" PinName="OUT"/><PCon UId="4" PinName="in"/></Wire>
<Wire><OCon UId="13"/><PCon UId="4" PinName="operand"/></Wire>
<Wire><OCon UId="14"/><PCon UId="5" PinName="in1"/></Wire><Wire><PCon UId="5" PinName="out"/><OCon UId="13"/></Wire>
<Wire><PCon UId="5" PinName="eno"/><PCon UId="6" PinName="en"/></Wire>
</Wires></FlgNet></Network>"""
SCL = """<Network Lang="SCL" NetPos="2"><SCLSource><Symbols><Symbol SymID="3" RefId="2"/></Symbols><RootStatements>
<Statement><Expression><SymVa SyId="3"/></Expression><BL/><OpAs/><BL/><Expression><Const TE="16#12" SyId="7"/></Expression>
<Odd/><FiSt/></Statement><NL/></RootStatements></SCLSource></Network>"""
NAMES = (
    '<IdentContainer><Ident Name="ready" RefId="1"/><Ident Name="a_x0020_b" RefId="2"/><Ident Name="motor" RefId="3"/>'
    "</IdentContainer>"
)
SECTIONS = (
    '<BlockInterface><Part><Payload><Root><Member Name="Input" SubPartIndex="1"/><Member Name="Temp" SubPartIndex="9"/></Root>'
    '</Payload><SubParts><Part/><Part><Payload><Member><Member Name="start"/><Member Name="stop"/></Member></Payload></Part>'
    "</SubParts></Part></BlockInterface>"
)


def plus(*bodies: str | bytes, names: str = NAMES, sections: str = SECTIONS) -> CarvedBlock:
    """A block of S7comm-plus with a body of these networks."""

    def blob(text: str | bytes) -> Blob:
        return Blob(0, b"\0\0\0\x01" + zlib.compress(text if isinstance(text, bytes) else text.encode("utf-8")))

    attributes = [
        Attribute(2533, Value(SPARSE_ARRAY, BLOB, [(number, blob(text)) for number, text in enumerate(bodies, 1)])),
        Attribute(2583, Value(SPARSE_ARRAY, BLOB, [(2, blob(names))])),
        Attribute(2544, Value(0, BLOB, blob(sections))),
    ]
    block = plus_block(build_object(PlusObject(0x8A320001, 2647, 0, 0, 0, [*attributes])))
    assert block is not None
    return block


def test_ladder_and_scl_with_names() -> None:
    assert networks(plus(SCL, LADDER), {}) == [
        PlusNetwork(1, "LAD", (
            "set motor := (ready OR NOT a b)",
            "Mul(in1 := ref 9) out => motor",
            "Move(en := Mul.ENO)",
        )),
        PlusNetwork(2, "SCL", ("a b := 16#12<Odd>;",)),
    ]  # fmt: skip
    assert interface(plus(SCL), {}) == [("Input", ["start", "stop"])]


def gates(parts: str, wires: str) -> tuple[str, ...]:
    """The lines of a network of these gates, whose operands are ready (UId 11), a b (12) and motor (13)."""
    operands = "".join([f'<ORef UId="{10 + number}" RefId="{number}"/>' for number in (1, 2, 3)])
    text = f'<Network NetPos="1"><FlgNet><Parts>{parts}{operands}</Parts><Wires>{wires}</Wires></FlgNet></Network>'
    found = networks(plus(text), {})
    assert found is not None
    return found[0].lines


def wired(source: str, *pins: str) -> str:
    """A wire from a gate's output (``1.out``), an operand (``11``) or the rail to inputs (``2.in``)."""
    gate, _, pin = source.partition(".")
    start = f'<PCon UId="{gate}" PinName="{pin}"/>' if pin else f'<OCon UId="{gate}"/>' if gate else "<Powerrail/>"
    ends = [f'<PCon UId="{uid}" PinName="{name}"/>' for uid, name in [each.split(".") for each in pins]]
    return f"<Wire>{start}{''.join(ends)}</Wire>"


@pytest.mark.parametrize(
    ("pins", "line"),
    [
        ((), "motor := ready AND a b"),
        (("operand",), "motor := NOT (ready AND a b)"),
        (("in",), "motor := NOT (ready AND a b)"),
        (("in", "operand"), "motor := ready AND a b"),
    ],
)
def test_a_negated_coil_writes_the_opposite(pins: tuple[str, ...], line: str) -> None:
    negated = "".join([f'<Negated PinName="{pin}"/>' for pin in pins])
    parts = f'<Part UId="1" Gate="Contact"/><Part UId="2" Gate="Contact"/><Part UId="3" Gate="Coil">{negated}</Part>'
    wires = wired("", "1.in") + wired("11", "1.operand") + wired("1.out", "2.in") + wired("12", "2.operand")
    assert gates(parts, wires + wired("2.out", "3.in") + wired("13", "3.operand")) == (line,)


def test_what_joins_is_negated_as_a_whole() -> None:
    parts = '<Part UId="1" Gate="A"/><Part UId="2" Gate="O"><Negated PinName="in1"/></Part><Part UId="3" Gate="Coil"/>'
    wires = wired("11", "1.in1") + wired("12", "1.in2", "2.in2") + wired("1.out", "2.in1")
    line = "motor := (NOT (ready AND a b) OR a b)"
    assert gates(parts, wires + wired("2.out", "3.in") + wired("13", "3.operand")) == (line,)


def test_a_call_names_its_instance() -> None:
    """So that two calls of one function block differ, and one that works with another instance now."""
    part = '<LRef UId="1" RefId="2"><Instance UId="9" RefId="{}"/></LRef><Part UId="2" Gate="Move"/>'
    wires = wired("", "1.en") + wired("11", "1.IN") + wired("1.eno", "2.en") + wired("12", "2.in")
    before, after = [gates(part.format(instance), wires) for instance in (3, 8)]
    assert before == ("CALL a b, motor(IN := ready)", "Move(en := CALL a b.ENO, in := a b)")
    assert after[0] == "CALL a b, ref 8(IN := ready)"
    was, now = [PlusNetwork(1, "LAD", lines) for lines in (before, after)]
    assert [change.text for change in compare_networks([was], [now])] == [f"{before[0]} → {after[0]}"]


def test_a_timer_names_its_instance() -> None:
    parts = '<Part UId="1" Gate="TON"><Instance UId="9" RefId="2"/></Part><Part UId="2" Gate="Coil"/>'
    wires = wired("11", "1.IN") + wired("1.Q", "2.in") + wired("13", "2.operand")
    assert gates(parts, wires) == ("motor := a b.TON(IN := ready).Q",)


def test_a_comparison_behind_contacts() -> None:
    parts = '<Part UId="1" Gate="Contact"/><Part UId="2" Gate="Lt"/><Part UId="3" Gate="Coil"><Negated PinName="in"/></Part>'
    wires = wired("", "1.in") + wired("11", "1.operand") + wired("1.out", "2.pre") + wired("12", "2.in1", "2.in2")
    line = "motor := NOT (ready AND Lt(in1 := a b, in2 := a b))"
    assert gates(parts, wires + wired("2.out", "3.in") + wired("13", "3.operand")) == (line,)


def test_what_enables_a_box_is_never_lost() -> None:
    """A box that only enables the next one has a line; what is compared to enable one stands in the line of that."""
    parts = '<Part UId="1" Gate="Lt"/><LRef UId="2" RefId="1"/><LRef UId="3" RefId="2"/>'
    wires = wired("", "1.pre") + wired("11", "1.in1") + wired("12", "1.in2") + wired("1.out", "2.en")
    assert gates(parts, wires + wired("13", "2.IN") + wired("2.eno", "3.en")) == (
        "CALL ready(IN := motor, en := Lt(in1 := ready, in2 := a b))",
        "CALL a b(en := CALL ready.ENO)",
    )


@pytest.mark.parametrize(("pins", "cut"), [(100, False), (400, True)])
def test_a_long_line_is_whole_and_one_too_long_says_that_it_is_cut(pins: int, cut: bool) -> None:
    """A call with many parameters: what is behind the first 400 characters is there, to be shown and compared."""
    wires = "".join([wired("11", f"1.PARAMETER_{number:03}") for number in range(pins)])
    (line,) = gates('<LRef UId="1" RefId="2"/>', wires)
    assert (len(line) == 4001 and line.endswith("…")) if cut else line.endswith("PARAMETER_099 := ready)")


def declared(payload: str, subparts: str = "") -> list[tuple[str, list[str]]]:
    """The sections of an interface whose root has this, and to which these parts belong."""
    text = f"<Part><Payload><Root>{payload}</Root></Payload><SubParts>{subparts}</SubParts></Part>"
    octets = b"\0\0\0\x01" + zlib.compress(f"<BlockInterface>{text}</BlockInterface>".encode())
    block = plus_block(
        build_object(PlusObject(0x8A0E0001, 2574, 0, 0, 0, [Attribute(2544, Value(0, BLOB, Blob(0, octets)))]))
    )
    assert block is not None
    return interface(block, {})


STRUCTURE = (
    '<Part/><Part Kind="Structure"><Payload><Member><Member Name="state" RID="5"/><Member Name="on" RID="1"/></Member>'
    "</Payload></Part>"
)


def test_the_interface_of_a_data_block() -> None:
    """Its variables stand in the root; a structure's members in a part; what has a type of its own is one name."""
    payload = (
        '<Member ID="51" Name="level" RID="8"/><Member ID="52" Name="command" RID="9" SubPartIndex="1"/>'
        '<Member ID="53" Name="connect" RID="7" SubPartIndex="0"/>'
    )
    assert declared(payload, STRUCTURE) == [("Static", ["level", "command.state", "command.on", "connect"])]


def test_the_interface_of_an_instance() -> None:
    """Sections hold their variables themselves; the numbers of parts are those of the part that has the sections."""
    payload = (
        '<Member Name="Input" SubPartIndex="0"><Member Name="REQ" RID="1"/></Member>'
        '<Member Name="Output" SubPartIndex="0"/>'
        '<Member Name="Static" SubPartIndex="0"><Member Name="TCON" RID="2" SubPartIndex="0"/>'
        '<Member Name="head" RID="3" SubPartIndex="1"><Member Name="id" RID="4"/></Member></Member>'
    )
    assert declared(payload, STRUCTURE) == [("Input", ["REQ"]), ("Static", ["TCON", "head.id"])]
    old = '<Member Name="Input" RID="0xFFFF" Type="Section" SubPartIndex="1"/><Member Name="Temp" RID="0xFFFF" Type="Section"/>'
    assert declared(old, STRUCTURE) == [("Input", ["state", "on"])]
    outer = f"<Part Kind='Values'><Payload><Values/></Payload><SubParts>{STRUCTURE}</SubParts></Part>"
    assert declared("", outer) == []


def test_structures_that_hold_themselves_end() -> None:
    inner = '<Member><Member Name="a" SubPartIndex="0" RID="1"/><Member Name="b" SubPartIndex="0" RID="1"/></Member>'
    part = f"<Part><Payload>{inner}</Payload></Part>"
    for _ in range(12):
        part = f"<Part><Payload>{inner}</Payload><SubParts>{part}</SubParts></Part>"
    ((_, names),) = declared('<Member Name="x" SubPartIndex="0" RID="1"/>', part)
    assert len(names) == 2**8
    assert names[0] == "x.a.a.a.a.a.a.a.a"


def test_in_the_listing_and_its_schema() -> None:
    told = CodeListing([plus(LADDER)], Places([], False), Clock())
    lines = [line.text for line in told.text()]
    assert "NETWORK 1 (LAD)" in lines
    assert "       set motor := (ready OR NOT a b)" in lines
    assert "  Input: start, stop" in lines
    assert complaints("blocks-code", told.as_dict(), exact=True) == []


def test_what_changed_by_network() -> None:
    other = LADDER.replace('NetPos="1"', 'NetPos="3"').replace('RefId="9"', 'RefId="1"')
    first, second = [plus(LADDER, SCL)], [plus(LADDER.replace("SCoil", "Coil"), SCL, other)]
    (change,) = compare(first, second)
    assert [(one.network, one.text) for one in details_of(first, second, "STL", None)(change)] == [
        (1, "set motor := (ready OR NOT a b) → motor := (ready OR NOT a b)"),
        (3, " added (3 lines)"),
    ]
    found = networks(first[0], {})
    assert found is not None
    assert compare_networks(found, found[1:])[0].text == " removed"


def test_what_changed_in_an_interface() -> None:
    """Names that it gained and lost; nothing is said where one of the two is not open."""
    first, second = [plus(SCL)], [plus(SCL, sections=SECTIONS.replace("stop", "halt"))]
    (change,) = compare(first, second)
    found = details_of(first, second, "STL", None)(change)
    assert [(one.about, one.text) for one in found] == [
        ("interface", "Input stop removed"),
        ("interface", "Input halt added"),
    ]
    shut = [plus(SCL, sections="no XML")]
    (change,) = compare(first, shut)
    assert details_of(first, shut, "STL", None)(change) == []


def test_one_line_that_is_added() -> None:
    added = compare_networks([], [PlusNetwork(1, "LAD", ("a := b",))])
    assert [change.text for change in added] == [" added (1 line)"]


def test_references_say_what_they_leave_out() -> None:
    assert [line.text for line in References([plus(SCL), plus(LADDER)]).text()] == [
        "not shown, as the code of an S7-1200/1500 is not public: OB1"
    ]
    assert [line.text for line in References([]).text()] == ["no block with code"]


def test_a_place_of_too_many_digits_is_none() -> None:
    found = networks(plus(LADDER.replace('NetPos="1"', f'NetPos="{"1" * 5000}"')), {})
    assert found is not None
    assert [network.number for network in found] == [0]


@pytest.mark.parametrize(
    "body",
    [
        b"no XML", b"<Network", b'<!DOCTYPE x [<!ENTITY a "b">]><Network>&a;</Network>',
        b'<!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/passwd">]><Network>&a;</Network>',
    ],
)  # fmt: skip
def test_xml_that_is_none_stays_closed(body: bytes) -> None:
    assert networks(plus(body), {}) is None
    assert [one.number for one in networks(plus(body, SCL), {}) or []] == [2]


def test_wires_in_a_circle_and_without_ends() -> None:
    circle = LADDER.replace("<Powerrail/>", '<PCon UId="4" PinName="out"/>').replace('UId="3" PinName="OUT"', 'UId="9"')
    (network,) = networks(plus(circle, "<Network><FlgNet><Wire/></FlgNet></Network>"), {})[1:] or [None]  # type: ignore[index]
    assert network is not None
    assert all([len(line) <= 400 for line in network.lines])


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.sampled_from(("PCon", "OCon", "Powerrail")), st.integers(0, 6)), max_size=30))
def test_any_wiring_is_bounded(ends: list[tuple[str, int]]) -> None:
    wires = "".join([
        f'<Wire><{tag} UId="{uid}" PinName="in"/><PCon UId="{number % 7}" PinName="IN{number}"/></Wire>'
        for number, (tag, uid) in enumerate(ends)
    ])  # fmt: skip
    parts = "".join([f'<Part UId="{uid}" Gate="O"/>' for uid in range(7)])
    found = networks(plus(f"<Network><FlgNet>{parts}{wires}</FlgNet></Network>"), {})
    assert found is not None
    assert len(found[0].lines) <= 7
