from __future__ import annotations

import gc
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.s7.layouts import MODE_TRANSITION, SETUP, USERDATA_EXTENDED, USERDATA_SHORT, VARIABLES_HEAD
from dissect.protocols.s7.parameters import PUSH, REQUEST, RESPONSE, ParameterCache, Parameters, parse_parameters
from dissect.protocols.s7.tables import ACK, ACK_DATA, FUNCTIONS, JOB, USERDATA, USERDATA_GROUPS, USERDATA_SUBFUNCTIONS
from dissect.wire.layout import Layout
from tests.build import userdata_head
from tests.engine.transactions.talk import dbw, head

KINDS = [JOB, ACK, ACK_DATA, USERDATA]


def faults(parameters: Parameters) -> list[tuple[str, str, int, int, int]]:
    return [(told.reason, told.field, told.offset, told.needed, told.available) for told in parameters.malformed]


def values(layout: Layout, octets: bytes) -> dict[str, int]:
    return {value.field.name: value.value for value in layout.read(octets)}


def test_an_empty_block() -> None:
    for rosctr in KINDS:
        parameters = parse_parameters(b"", rosctr)
        assert (parameters.function, parameters.item_count, parameters.malformed) == (-1, -1, [])
        assert parameters.function_name == "no function"


@pytest.mark.parametrize("function", [0x00, 0x1A, 0x1B, 0x1C, 0x1D, 0x1E, 0x1F, 0x28, 0x29, 0x77])
def test_other_functions_are_named_and_kept_as_octets(function: int) -> None:
    octets = bytes((function, 1, 2, 3))
    parameters = parse_parameters(octets, JOB)
    assert (parameters.octets, parameters.function, parameters.item_count) == (octets, function, -1)
    assert (parameters.items, parameters.setup, parameters.userdata, parameters.malformed) == ([], None, None, [])
    assert parameters.function_name == FUNCTIONS.name(function)


# ---- setup ----------------------------------------------------------------------------------------------------------


@given(st.binary(min_size=7, max_size=7))
def test_setup_is_its_layout(octets: bytes) -> None:
    octets = b"\xf0" + octets
    for rosctr in (JOB, ACK_DATA):
        parameters = parse_parameters(octets, rosctr)
        assert parameters.setup is not None
        expected = values(SETUP, octets)
        assert parameters.setup.as_dict() == {
            name: expected[name] for name in ("max_amq_calling", "max_amq_called", "pdu_length")
        }
        assert parameters.malformed == []


@pytest.mark.parametrize("size", [1, 2, 7, 9, 20])
def test_setup_of_another_size(size: int) -> None:
    parameters = parse_parameters((b"\xf0\x00\x00\x01\x00\x02\x01\xe0" + bytes(12))[:size], JOB)
    reason = "too_short" if size < 8 else "trailing_octets"
    assert faults(parameters) == [(reason, "setup", min(size, 8), 8, size)]
    assert (parameters.setup is None) is (size < 8)


# ---- read and write -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("function", [4, 5])
@given(count=st.integers(0, 255))
def test_answer_head_is_its_layout(function: int, count: int) -> None:
    octets = bytes((function, count))
    parameters = parse_parameters(octets, ACK_DATA)
    assert values(VARIABLES_HEAD, octets) == {"function": parameters.function, "item_count": parameters.item_count}
    assert (parameters.items, parameters.malformed) == ([], [])


@pytest.mark.parametrize("function", [4, 5])
def test_an_answer_carries_no_items(function: int) -> None:
    parameters = parse_parameters(bytes((function, 1)) + dbw(1, 0), ACK_DATA)
    assert faults(parameters) == [("trailing_octets", "item_count", 2, 2, 14)]
    assert parameters.items == []


@pytest.mark.parametrize("function", [4, 5])
def test_a_block_without_item_count(function: int) -> None:
    for rosctr in (JOB, ACK_DATA):
        assert faults(parse_parameters(bytes((function,)), rosctr)) == [("too_short", "item_count", 1, 2, 1)]
    assert parse_parameters(bytes((function,)), ACK).malformed == []


# ---- userdata -------------------------------------------------------------------------------------------------------


@given(st.integers(0, 3), st.integers(0, 63), st.integers(0, 255), st.integers(0, 255))
def test_short_head_is_its_layout(type_: int, group: int, subfunction: int, sequence: int) -> None:
    octets = head(type_, group, subfunction, sequence)
    parameters = parse_parameters(octets, USERDATA)
    told = parameters.userdata
    assert told is not None
    expected = values(USERDATA_SHORT, octets)
    assert {name: getattr(told, name) for name in ("type", "group", "subfunction", "sequence")} == {
        name: expected[name] for name in ("type", "group", "subfunction", "sequence")
    }
    assert (told.type, told.group, told.subfunction, told.sequence) == (type_, group, subfunction, sequence)
    assert (told.extended, told.error_code, parameters.item_count, parameters.malformed) == (False, 0, 1, [])


@given(st.binary(min_size=7, max_size=7))
def test_extended_head_is_its_layout(rest: bytes) -> None:
    octets = b"\x00\x01\x12\x08\x12" + rest
    parameters = parse_parameters(octets, USERDATA)
    told = parameters.userdata
    assert told is not None
    expected = values(USERDATA_EXTENDED, octets)
    for name in ("type", "group", "subfunction", "sequence", "data_unit_ref", "last_data_unit", "error_code"):
        assert getattr(told, name) == expected[name], name
    assert (told.extended, parameters.malformed) == (True, [])


@given(st.integers(0, 255))
def test_mode_transition_is_its_layout(mode: int) -> None:
    octets = b"\x01\x00\x10\x10\x00\x00" + bytes((mode, 0))
    parameters = parse_parameters(octets, USERDATA)
    told = parameters.userdata
    assert told is not None
    assert (told.type, told.group, told.subfunction) == (PUSH, 0, values(MODE_TRANSITION, octets)["mode"])
    assert parameters.malformed == []


@pytest.mark.parametrize(("size", "reason"), [(1, "too_short"), (7, "too_short"), (9, "trailing_octets")])
def test_mode_transition_of_another_size(size: int, reason: str) -> None:
    parameters = parse_parameters(b"\x01\x00\x10\x10\x00\x00\x04\x00\x00"[:size], USERDATA)
    assert [fault[0] for fault in faults(parameters)] == [reason]
    assert (parameters.userdata is None) is (size < 8)


def test_usend_has_its_r_id_where_others_have_the_head() -> None:
    parameters = parse_parameters(bytes.fromhex("00011206130000000001"), USERDATA)
    assert parameters.userdata is not None
    assert (parameters.userdata.group, parameters.userdata.usend, parameters.malformed) == (6, True, [])
    longer = parse_parameters(bytes.fromhex("000112081346010000000001"), USERDATA)
    assert faults(longer) == [("bad_value", "userdata head.syntax_id", 4, 0x12, 0x13)]


@pytest.mark.parametrize(
    ("octets", "fault"),
    [
        ("05011204114401", ("too_short", "userdata head", 7, 8, 7)),
        ("0501120411440100", ("bad_value", "userdata head.function", 0, 0, 5)),
        ("0002120411440100", ("bad_value", "userdata head.item_count", 1, 1, 2)),
        ("0001130411440100", ("bad_value", "userdata head.specification", 2, 0x12, 0x13)),
        ("0001120811440100", ("length_beyond", "userdata head.length", 3, 8, 4)),
        ("000112041144010000000000", ("trailing_octets", "userdata head.length", 3, 4, 8)),
        ("00011206114401000000", ("bad_value", "userdata head.length", 3, 4, 6)),
        ("0001120412440100", ("bad_value", "userdata head.syntax_id", 4, 0x11, 0x12)),
        ("000112081184010000000000", ("bad_value", "userdata head.syntax_id", 4, 0x12, 0x11)),
    ],
)
def test_heads_that_contradict_themselves(octets: str, fault: tuple[str, str, int, int, int]) -> None:
    parameters = parse_parameters(bytes.fromhex(octets), USERDATA)
    assert faults(parameters) == [fault]
    assert (parameters.userdata is None) is (len(octets) < 16)


def test_names_of_userdata() -> None:
    def name(group: int, subfunction: int) -> str:
        return parse_parameters(head(REQUEST, group, subfunction), USERDATA).function_name

    assert name(4, 1) == "CPU functions: read SZL"
    assert name(4, 0x77) == "CPU functions: 0x77"
    assert name(0x2A, 1) == "0x2a: 0x01"
    for group, table in USERDATA_SUBFUNCTIONS.items():
        for row in table:
            assert name(group, row.number) == f"{USERDATA_GROUPS.name(group)}: {row.name}"


@given(st.sampled_from(KINDS), st.binary(max_size=64))
def test_any_block(rosctr: int, octets: bytes) -> None:
    parameters = parse_parameters(octets, rosctr)
    assert parameters.octets == octets
    assert parameters.rosctr == rosctr
    assert parameters.function == (octets[0] if octets else -1)
    assert parameters.function_name
    for fault in parameters.malformed:
        assert 0 <= fault.offset <= len(octets)
        assert fault.limit in {"param", "item"}
    if rosctr == USERDATA and octets:
        assert (parameters.userdata is None) is (len(octets) < 8)
        if parameters.userdata is not None:
            assert parameters.userdata.type in {PUSH, REQUEST, RESPONSE, 3}


# ---- the cache ------------------------------------------------------------------------------------------------------


def found(cache: ParameterCache, octets: bytes, rosctr: int) -> Parameters:
    return cache.get(b"?" + octets + b"?", 1, 1 + len(octets), rosctr)


def test_cache_gives_every_short_answer() -> None:
    cache = ParameterCache()
    for function in (0x04, 0x05, 0xF0):
        for count in range(256):
            block = bytes((function, count))
            for rosctr in (JOB, ACK_DATA):
                first = found(cache, block, rosctr)
                told, parsed = [
                    (one.octets, one.rosctr, one.function, one.item_count, len(one.malformed))
                    for one in (first, parse_parameters(block, rosctr))
                ]
                assert told == parsed
                assert found(cache, block, rosctr) is first


def test_cache_gives_the_same_object_for_the_same_octets() -> None:
    cache = ParameterCache()
    octets = b"\x04\x01" + dbw(1, 2)
    first = found(cache, octets, JOB)
    assert found(cache, bytes(bytearray(octets)), JOB) is first
    assert first.items[0].address == "DB1.DBW2"


def test_cache_tells_blocks_apart_that_end_alike() -> None:
    """Of many blocks with the same length and last address each is found again, also behind a younger generation."""
    cache = ParameterCache()
    blocks = [b"\x04\x02" + dbw(number, 7) + dbw(1, 2) for number in range(1, 40)]
    first = [found(cache, block, JOB) for block in blocks]
    for block, known in zip(blocks, first, strict=True):
        assert found(cache, block, JOB) is known
        assert known.octets == block
        assert found(cache, block, ACK_DATA) is not known
    for number in range(ParameterCache.CAPACITY):
        found(cache, b"\x1e\x00\x00\x00" + number.to_bytes(4, "big"), JOB)
    assert [found(cache, block, JOB) for block in blocks] == first


def test_cache_keeps_requests_and_answers_apart() -> None:
    cache = ParameterCache()
    asked = found(cache, b"\xf0\x00\x00\x01\x00\x01\x01\xe0", JOB)
    told = found(cache, b"\xf0\x00\x00\x01\x00\x01\x01\xe0", ACK_DATA)
    assert (asked.rosctr, told.rosctr) == (JOB, ACK_DATA)


@pytest.fixture
def nothing_else() -> Iterator[None]:
    """Keep what other tests left behind out of the counting, which would take long."""
    gc.freeze()
    yield
    gc.unfreeze()


def held(of: type) -> int:
    """How many objects of a class there are."""
    gc.collect()
    return sum(1 for thing in gc.get_objects() if type(thing) is of)


def test_cache_is_bounded_in_blocks(nothing_else: None) -> None:
    """Two generations of them."""
    before = held(Parameters)
    cache = ParameterCache()
    most = 0
    for number in range(3 * ParameterCache.CAPACITY):
        found(cache, b"\x1e\x00\x00\x00" + number.to_bytes(4, "big"), JOB)
        if number % 2000 == 1999:
            most = max(most, held(Parameters) - before)
    assert ParameterCache.CAPACITY < most <= 2 * ParameterCache.CAPACITY


def test_cache_is_bounded_in_octets(nothing_else: None) -> None:
    before = held(Parameters)
    cache = ParameterCache()
    block = bytes(60_000)
    most = 0
    for number in range(40):
        kind = KINDS[number % len(KINDS)]
        parameters = found(cache, b"\x28" + block + bytes((number,)), kind)
        assert parameters.octets[-1] == number
        del parameters
        most = max(most, held(Parameters) - before)
    assert most == 2 * (ParameterCache.OCTETS // 60_002)


def test_what_is_polled_stays_while_others_come_once() -> None:
    cache = ParameterCache()
    polled = b"\x04\x01" + dbw(1, 2)
    first = found(cache, polled, JOB)
    for number in range(3 * ParameterCache.CAPACITY):
        found(cache, b"\x1e\x00\x00\x00" + number.to_bytes(4, "big"), JOB)
        if number % 5000 == 0:
            assert found(cache, polled, JOB) is first
    for number in range(2 * ParameterCache.CAPACITY):
        found(cache, b"\x1d\x00\x00\x00" + number.to_bytes(4, "big"), JOB)
    assert found(cache, polled, JOB) is not first


def test_a_block_larger_than_the_cache_is_parsed_all_the_same() -> None:
    cache = ParameterCache()
    octets = b"\x28" + bytes(ParameterCache.OCTETS + 1)
    assert found(cache, octets, JOB).octets == octets


@pytest.mark.parametrize(
    ("unit", "last", "more", "continues"),
    [(0, 0, False, False), (7, 1, True, False), (7, 0, False, True), (0, 1, False, False)],
    ids=["whole", "first", "last", "a mark without a reference"],
)
def test_which_part_of_an_answer_it_is(unit: int, last: int, more: bool, continues: bool) -> None:
    head = parse_parameters(userdata_head(2, 4, 1, 5, unit, last), USERDATA).userdata
    assert head is not None
    assert (head.more, head.continues) == (more, continues)
