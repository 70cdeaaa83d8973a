from __future__ import annotations

from typing import Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.iso import layouts
from dissect.protocols.iso.cotp import (
    CALLED_TSAP,
    CALLING_TSAP,
    MAX_TSDU,
    PREFERRED_SIZE,
    TPDU_SIZE,
    Assembler,
    Tpdu,
    parse_tpdu,
)
from dissect.protocols.iso.tables import AK, CC, CR, DC, DR, DT, EA, ED, ER, PARAMETERS, RJ, UD
from dissect.wire.layout import Layout
from dissect.wire.malformed import LIMITS, REASONS
from tests.cases import each
from tests.protocols.iso.tpdus import TPDUS, Fields, Parameters


@each(("name", "octets", "fields", "parameters", "data"), TPDUS)
def test_every_tpdu_and_form(name: str, octets: str, fields: Fields, parameters: Parameters, data: str) -> None:
    tpdu = parse_tpdu(bytes.fromhex(octets))
    assert tpdu.malformed == []
    assert (tpdu.name, tpdu.type, tpdu.layout.name) == (name, fields["type"], name)
    assert {value.field.name: value.value for value in tpdu.fields} == fields
    assert {name: tpdu.field(name) for name in fields} == fields
    assert [(one.code, one.value.hex(), one.offset) for one in tpdu.parameters] == parameters
    assert tpdu.variable.hex() == "".join(f"{code:02x}{len(value) // 2:02x}{value}" for code, value, _ in parameters)
    assert tpdu.data.hex() == data


#: LI and the form it calls for, of the types that have several.
FORMS: Final[dict[int, list[tuple[int, Layout]]]] = {
    DT: [
        *[(li, layouts.DT) for li in (2, 3)],
        *[(li, layouts.DT_NORMAL) for li in (4, 5, 6, 8)],
        *[(li, layouts.DT_EXTENDED) for li in (7, 9, 11, 254)],
    ],
    ED: [
        *[(li, layouts.ED) for li in (2, 3)],
        *[(li, layouts.ED_NORMAL) for li in (4, 5, 6, 8)],
        *[(li, layouts.ED_EXTENDED) for li in (7, 9, 11, 254)],
    ],
    AK: [
        *[(li, layouts.AK) for li in (2, 3, 4, 6, 8, 10)],
        *[(li, layouts.AK_EXTENDED) for li in (9, 11, 13, 254)],
    ],
    RJ: [*[(li, layouts.RJ) for li in (2, 4, 8, 10)], *[(li, layouts.RJ_EXTENDED) for li in (9, 11)]],
    EA: [*[(li, layouts.EA) for li in (2, 4, 6, 8)], *[(li, layouts.EA_EXTENDED) for li in (7, 9, 11)]],
}


@each(("type_", "li", "layout"), [(type_, li, layout) for type_, forms in FORMS.items() for li, layout in forms])
def test_the_form_is_chosen_by_li(type_: int, li: int, layout: Layout) -> None:
    tpdu = parse_tpdu(bytes((li, type_ << 4)) + bytes(li - 1) + b"user")
    assert tpdu.layout is layout
    assert tpdu.data == b"user"


@pytest.mark.parametrize("type_", range(16))
def test_types_that_nobody_knows(type_: int) -> None:
    tpdu = parse_tpdu(bytes((6, type_ << 4 | 9, 0, 0, 0, 0, 0)) + b"data")
    known = type_ in {CR, CC, DR, DC, DT, ED, AK, EA, RJ, ER}
    assert ("unknown_type" in [fact.reason for fact in tpdu.malformed]) is not known
    assert tpdu.data == b"data"
    if not known:
        assert tpdu.name == ("UD" if type_ == UD else f"0x{type_:x}")
        assert (tpdu.field("li"), tpdu.field("type"), tpdu.field("credit")) == (6, type_, 9)
        assert tpdu.field("dst_ref") == -1


@pytest.mark.parametrize("octets", [b"", b"\x02"])
def test_too_short_for_a_type(octets: bytes) -> None:
    tpdu = parse_tpdu(octets)
    assert (tpdu.type, tpdu.name, tpdu.fields, tpdu.data) == (-1, "TPDU", [], b"")
    assert [str(fact) for fact in tpdu.malformed] == [f"cotp: type at byte 0 needs 2 bytes, the TPKT has {len(octets)}"]


@each("type_", range(16))
@each("li", [0, 255])
def test_li_that_the_standard_forbids(type_: int, li: int) -> None:
    tpdu = parse_tpdu(bytes((li, type_ << 4)) + bytes(260))
    assert [(fact.reason, fact.field, fact.available) for fact in tpdu.malformed] == [("bad_value", "li", li)]
    assert (tpdu.fields, tpdu.parameters, tpdu.data) == ([], [], b"")


@pytest.mark.parametrize(("octets", "li_min"), [(octets, fields) for _, octets, fields, _, _ in TPDUS[:13]])
def test_every_li(octets: str, li_min: Fields) -> None:
    """Too small for the fixed part, in the middle of a parameter, beyond the TPDU: told, and what is there is kept."""
    whole = bytearray.fromhex(octets)
    for li in range(1, 255):
        whole[0] = li
        tpdu = parse_tpdu(bytes(whole))
        reasons = [(fact.reason, fact.field) for fact in tpdu.malformed]
        assert (("length_beyond", "li") in reasons) is (li + 1 > len(whole))
        assert (("too_short", tpdu.layout.name) in reasons) is (tpdu.layout.size > min(li + 1, len(whole)))
        assert tpdu.data == bytes(whole[li + 1 :])
        assert tpdu.variable == bytes(whole[tpdu.layout.size : li + 1])


@pytest.mark.parametrize(
    ("parameters", "kept", "reason", "offset"),
    [
        ("c0", 0, "too_short", 7),
        ("c0010a c1", 1, "too_short", 10),
        ("c0010a c102", 1, "length_beyond", 10),
        ("c0010a c10201", 1, "length_beyond", 10),
        ("c0ff0a", 0, "length_beyond", 7),
        ("c000 c10100 00", 2, "too_short", 12),
    ],
)
def test_parameters_that_do_not_fit(parameters: str, kept: int, reason: str, offset: int) -> None:
    variable = bytes.fromhex(parameters)
    tpdu = parse_tpdu(bytes((6 + len(variable),)) + bytes.fromhex("e00000004b00") + variable + b"data")
    assert [(fact.reason, fact.field, fact.offset) for fact in tpdu.malformed] == [(reason, "parameter", offset)]
    assert (len(tpdu.parameters), tpdu.variable, tpdu.data) == (kept, variable, b"data")


def consistent(octets: bytes) -> Tpdu:
    """Parse; whatever the octets say, what was read stands in them, and faults are of the closed sets."""
    tpdu = parse_tpdu(octets)
    for fact in tpdu.malformed:
        assert fact.reason in REASONS
        assert fact.limit in LIMITS
        assert 0 <= fact.offset <= len(octets)
    for value in tpdu.fields:
        assert value.end <= len(octets)
    for one in tpdu.parameters:
        assert octets[one.offset : one.offset + 2] == bytes((one.code, len(one.value)))
        assert octets[one.offset + 2 : one.offset + 2 + len(one.value)] == one.value
        assert one.name
    if not tpdu.malformed:
        assert octets == octets[: tpdu.layout.size] + tpdu.variable + tpdu.data
        assert sum(2 + len(one.value) for one in tpdu.parameters) == len(tpdu.variable)
    assert tpdu.tpdu_size >= 0
    for code in (CALLING_TSAP, CALLED_TSAP):
        tsap = tpdu.tsap(code)
        assert tsap is None or (tsap.octets == tpdu.parameter(code) and tsap.describe() is not None)
    return tpdu


@each("octets", [octets for _, octets, _, _, _ in TPDUS])
def test_every_truncation_and_every_octet_changed(octets: str) -> None:
    whole = bytes.fromhex(octets)
    for size in range(len(whole)):
        consistent(whole[:size])
    for at in range(min(len(whole), 40)):
        for value in range(256):
            consistent(whole[:at] + bytes((value,)) + whole[at + 1 :])


@given(
    st.one_of(
        st.binary(max_size=60),
        st.tuples(st.integers(1, 40), st.binary(max_size=60)).map(lambda t: bytes((t[0],)) + t[1]),
    )
)
def test_any_octets(octets: bytes) -> None:
    consistent(octets)


# ---- parameters -----------------------------------------------------------------------------------------------------


def cr(variable: bytes) -> Tpdu:
    return parse_tpdu(bytes((6 + len(variable),)) + bytes.fromhex("e00000004b00") + variable)


def test_tpdu_size_of_every_value() -> None:
    expected = {7: 128, 8: 256, 9: 512, 10: 1024, 11: 2048, 12: 4096, 13: 8192, 14: 16384, 15: 32768, 16: 65531}
    for value in range(256):
        assert cr(bytes((TPDU_SIZE, 1, value))).tpdu_size == expected.get(value, 0), value


@pytest.mark.parametrize(
    ("variable", "size"),
    [
        ("", 0),
        ("c000", 0),
        ("c002000a", 0),
        ("f00101", 128),
        ("f00108", 1024),
        ("f0020200", 65536),
        ("f003000008", 1024),
        ("f004ffffffff", (2**32 - 1) * 128),
        ("f000", 0),
        ("f0050000000008", 0),
        ("c0010a f00104", 512),  # goes before the TPDU size
        ("f00104 c0010a", 512),
        ("c00109 c0010a", 1024),  # the last one counts
        ("c0010a f000", 1024),
    ],
)
def test_tpdu_size(variable: str, size: int) -> None:
    assert cr(bytes.fromhex(variable)).tpdu_size == size


def test_the_last_parameter_of_a_code_counts() -> None:
    tpdu = cr(bytes.fromhex("c2020102 c1020100 c2020103"))
    assert tpdu.parameter(CALLED_TSAP) == b"\x01\x03"
    assert [str(tpdu.tsap(code)) for code in (CALLING_TSAP, CALLED_TSAP)] == ["01.00", "01.03"]
    assert tpdu.parameter(PREFERRED_SIZE) is None
    assert tpdu.tsap(PREFERRED_SIZE) is None


def test_parameters_have_names() -> None:
    tpdu = cr(bytes.fromhex("c000 c100 0100 f000"))
    assert [one.name for one in tpdu.parameters] == [
        "TPDU size",
        "calling TSAP (CR, CC); invalid TPDU (ER)",
        "0x01",
        "preferred maximum TPDU size",
    ]
    assert len(PARAMETERS) == 21


# ---- assembly -------------------------------------------------------------------------------------------------------


def test_one_dt_is_a_tsdu() -> None:
    assembler = Assembler()
    assert assembler.push(b"whole", True) == b"whole"
    assert assembler.push(b"", True) == b""
    assert (assembler.clear, assembler.parts, assembler.dropped) == (True, None, 0)


@given(st.lists(st.binary(max_size=8), min_size=1, max_size=20))
def test_any_fragments(parts: list[bytes]) -> None:
    assembler = Assembler()
    for part in parts[:-1]:
        assert assembler.push(part, False) is None
    assert assembler.clear is (b"".join(parts[:-1]) == b"")
    assert assembler.push(parts[-1], True) == b"".join(parts)
    assert assembler.clear
    assert assembler.push(b"next", True) == b"next"


def test_empty_dts_begin_nothing() -> None:
    assembler = Assembler()
    for _ in range(100):
        assert assembler.push(b"", False) is None
        assert assembler.clear
    assert assembler.push(b"whole", True) == b"whole"


def test_empty_dts_inside_and_at_the_end() -> None:
    assembler = Assembler()
    assert assembler.push(b"begin", False) is None
    assert assembler.push(b"", False) is None
    assert not assembler.clear
    assert assembler.push(b" end", False) is None
    assert assembler.push(b"", True) == b"begin end"


@pytest.mark.parametrize("last", [True, False])
def test_a_tsdu_that_grows_too_long_is_dropped_up_to_its_end(last: bool) -> None:
    assembler = Assembler()
    for _ in range(64):
        assert assembler.push(bytes(1024), False) is None
    assert assembler.overflows == 0
    assert assembler.push(b"x", last) is None
    assert (assembler.overflows, assembler.dropped, assembler.parts) == (1, MAX_TSDU + 1, None)
    assert assembler.clear is last
    if not last:
        assert assembler.push(bytes(10), False) is None
        assert not assembler.clear
        assert assembler.push(bytes(10), True) is None
    assert (assembler.overflows, assembler.dropped) == (1, MAX_TSDU + (1 if last else 21))
    assert assembler.push(b"next", True) == b"next"


def test_the_longest_tsdu() -> None:
    assembler = Assembler()
    for _ in range(63):
        assembler.push(bytes(1024), False)
    whole = assembler.push(bytes(1024), True)
    assert whole == bytes(MAX_TSDU)


def test_the_end_never_set_takes_no_memory() -> None:
    assembler = Assembler()
    for _ in range(2000):
        assembler.push(bytes(1000), False)
        assert assembler.parts is None or len(assembler.parts) <= MAX_TSDU
    assert (assembler.overflows, assembler.dropped) == (1, 2_000_000)


def test_an_abandoned_tsdu_is_counted() -> None:
    assembler = Assembler()
    assert assembler.abandon() == 0
    assembler.push(b"lost", False)
    assert assembler.abandon() == 4
    assert (assembler.dropped, assembler.clear) == (4, True)
    assert assembler.push(b"next", True) == b"next"
    assembler.push(bytes(MAX_TSDU), False)
    assembler.push(b"x", False)
    assert assembler.abandon() == 0  # dropped and counted already
    assert assembler.clear
