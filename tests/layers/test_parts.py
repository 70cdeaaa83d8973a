"""Parts as Scapy packets: one class for each structure the engine knows, lists of them, counts that are filled in."""

from __future__ import annotations

import importlib
import pkgutil
from random import Random
from typing import Any, Final

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scapy.packet import Packet, Raw, fuzz

import dissect.layers
import dissect.protocols.s7
import dissect.protocols.s7.security
from dissect.layers import (
    S7,
    S7_CyclicRequest,
    S7_CyclicValues,
    S7_DataHead,
    S7_DataItem,
    S7_Fill,
    S7_Job,
    S7_Octets,
    S7_OtherItem,
    S7_Part,
    S7_RecordStatus,
    S7_ReturnCode,
    S7_TestAnswer,
    S7_TestHead,
    S7_TestRequest,
    S7_TestVariables,
    S7_UserdataShort,
    at,
)
from dissect.layers.fields import scapy_name
from dissect.layers.parts import CLASSES
from dissect.protocols.s7 import blocks, layouts, pbc
from dissect.protocols.s7plus import layouts as plus_layouts
from dissect.wire import part as wire_part
from dissect.wire.layout import Layout
from tests.cases import each
from tests.layers.support import shown, survives

#: Layouts that other layers hold: headers, and the heads of bodies.
ELSEWHERE: Final = {
    layouts.HEADER,
    layouts.ACK_HEADER,
    layouts.SETUP,
    layouts.VARIABLES_HEAD,
    layouts.USERDATA_SHORT,
    layouts.USERDATA_EXTENDED,
    layouts.MODE_TRANSITION,
    pbc.USEND_HEAD,
    blocks.FOOTER,  # of a whole block, which no PDU holds
    plus_layouts.HEADER,
    plus_layouts.KEEP_ALIVE,
    plus_layouts.INTEGRITY,
    plus_layouts.REQUEST,
    plus_layouts.RESPONSE,
    plus_layouts.NOTIFICATION,
    plus_layouts.NOTIFICATION_V1,
    plus_layouts.EVENT,
    plus_layouts.EVENT_VALUE,  # the message of an S7Plus_Event
}
PARTS: Final = sorted({cls for cls in CLASSES.values() if issubclass(cls, S7_Part)}, key=lambda cls: cls.__name__)


def known_layouts() -> dict[Layout, str]:
    """Every layout of the engine's modules for S7 and of S7comm-plus, also those in their tables, with where it stands."""
    found: dict[Layout, str] = {}
    modules = [
        importlib.import_module(f"dissect.protocols.s7.{one.name}")
        for one in pkgutil.iter_modules(dissect.protocols.s7.__path__)
    ]
    for module in [*modules, plus_layouts, wire_part]:
        for name, value in vars(module).items():
            values: list[Any] = [value]
            if isinstance(value, dict):
                values = list(value.values())
            elif isinstance(value, list | tuple | frozenset):
                values = list(value)
            for one in values:
                for layout in one if isinstance(one, list | tuple) else [one]:
                    if isinstance(layout, Layout):
                        found.setdefault(layout, f"{module.__name__}.{name}")
    return found


def test_each_structure_has_a_class_of_its_own() -> None:
    known = known_layouts()
    assert len(known) > 70
    missing = {where for layout, where in known.items() if layout not in CLASSES and layout not in ELSEWHERE}
    assert not missing
    assert len(set(CLASSES.values())) == len(CLASSES)
    assert set(CLASSES) <= set(known)


def test_each_class_is_public_and_says_what_it_is() -> None:
    for layout, cls in CLASSES.items():
        assert cls.__name__ in dissect.layers.__all__, cls.__name__
        assert cls.__doc__
        assert cls._name.startswith(("S7 ", "S7comm-plus ")) or cls.__name__ == "S7_Any", cls.__name__
        assert [field.name for field in layout.fields if scapy_name(field.name) not in cls().default_fields] == []


@settings(max_examples=1)  # of seeds: each is several thousand cases
@given(rng=st.randoms(use_true_random=True))
def test_the_fields_of_a_part_are_those_of_its_layout(rng: Random) -> None:
    for cls in PARTS:
        size = cls.layout.size
        # Around the size of the layout every length counts: what is cut off, and what is left over.
        cases = [rng.randbytes(length) for length in (*range(1, size + 5), size + 9, size + 17, 80)]
        for octets in (*cases, bytes(size + 2), b"\xff" * (size + 2), b"\x80" * (size + 2)):
            try:
                _fields_are_those_of_the_layout(cls, octets)
            except Exception as error:
                error.add_note(f"the case: {cls.__name__}, {octets.hex()}")
                raise


def _fields_are_those_of_the_layout(cls: type[S7_Part], octets: bytes) -> None:
    part = survives(cls, octets)
    values = cls.layout.read(octets)
    if len(octets) < cls.layout.size or len(values) < len(cls.layout.fields):
        assert type(part) is Raw
        return
    for value in values:
        name = scapy_name(value.field.name)
        given = part.getfieldval(name)
        if value.octets is not None and not isinstance(given, bytes):  # as S7comm-plus has it: a number, a list, a text
            given = part.get_field(name).addfield(part, b"", given)
        assert given == (value.value if value.octets is None else value.octets), value.field.name


@each("cls", PARTS)
def test_a_part_is_built_without_values_and_with_any(cls: type[S7_Part]) -> None:
    if not cls.__name__.startswith("S7Plus_"):  # whose numbers have variable sizes
        assert len(bytes(cls())) == cls.layout.size + len(cls().default_fields.get("service", b""))
    assert type(cls(bytes(cls()))) is cls or not bytes(cls())
    for _ in range(3):
        packet = S7() / S7_Job(parameters=[fuzz(cls()), S7_Octets(octets=b"abc")])
        assert packet.summary() == "" or set(cls().default_fields.values()) == {None}
        survives(S7, bytes(packet))


@given(st.lists(st.tuples(st.sampled_from(PARTS), st.binary(max_size=40)), max_size=6), st.sampled_from((1, 3, 7)))
def test_any_list_of_parts_is_built_as_it_stands(parts: list[tuple[type[S7_Part], bytes]], rosctr: int) -> None:
    packets = [cls(octets) for cls, octets in parts if octets]
    expected = b"".join(octets for _, octets in parts)
    body = S7_Job(parameters=[Raw(b"\x28"), *packets], data=packets)
    assert bytes(body) == b"\x28" + expected + expected
    survives(S7, bytes(S7(rosctr=rosctr) / body))


# ---- counts ----------------------------------------------------------------------------------------------------------


def built(*parts: Packet) -> str:
    """The parts of a parameter block as they are built, in hexadecimal."""
    return bytes(S7_Job(parameters=list(parts))).hex(" ")


def test_what_counts_the_rest_of_its_part() -> None:
    assert bytes(S7_RecordStatus(status=b"abc")).hex() == "03616263"
    assert built(S7_RecordStatus(status=b"abc"), S7_Fill()) == "03 61 62 63 00"
    assert built(S7_RecordStatus(status_length=9, status=b"abc")) == "09 61 62 63"


def test_what_counts_the_octets_behind() -> None:
    assert built(S7_DataHead(), S7_Octets(octets=b"ab"), Raw(b"c")) == "ff 09 00 03 61 62 63"
    assert built(S7_DataHead()) == "0a 00 00 00"
    assert built(S7_DataHead(return_code=0xFF)) == "ff 00 00 00"


def test_what_counts_parts_of_a_kind() -> None:
    item = S7_DataItem(octets=b"a")
    assert built(S7_CyclicValues(), item, S7_ReturnCode(), item)[:5] == "00 02"
    assert built(S7_CyclicValues(), item, S7_CyclicValues(), item)[:5] == "00 01"
    assert built(S7_CyclicValues(reserved=7), item)[:5] == "07 01"
    assert built(S7_CyclicRequest(), at("MW0"), S7_OtherItem(syntax_id=0xB0, octets=b"ab"))[:11] == "00 02 01 01"
    with pytest.raises(ValueError, match="item_count of S7 cyclic values would be 256, more than it can say"):
        built(S7_CyclicValues(), *[item] * 256)


def test_the_sizes_of_a_programmer_command() -> None:
    assert built(S7_TestHead(), S7_TestRequest(), S7_TestVariables())[:11] == "00 14 00 02"
    assert built(S7_TestHead(), S7_TestAnswer())[:11] == "00 04 00 00"


def test_fill_octets_stand_between_items_only() -> None:
    odd = S7_DataItem(octets=b"a")
    assert built(odd, odd) == "ff 04 00 08 61 00 ff 04 00 08 61"
    assert built(odd, S7_ReturnCode()) == "ff 04 00 08 61 ff"
    assert built(S7_DataItem(octets=b"a", fill=b""), odd) == "ff 04 00 08 61 ff 04 00 08 61"


def test_a_count_that_was_deleted_is_filled_in_again() -> None:
    packet = S7(bytes(S7() / S7_UserdataShort(group=2, data=[S7_DataHead(), S7_CyclicRequest(), at("MB1"), at("MB2")])))
    packet.data.pop()
    del packet.data_length, packet.data[0].length, packet.data[1].item_count
    again = S7(bytes(packet))
    assert (again.data_length, again.data[0].length, again.data[1].item_count) == (20, 16, 1)


def test_the_head_of_a_system_status_list() -> None:
    led, rest = dissect.layers.S7_SZLLED(led=4), dissect.layers.S7_SZLRecordRest(octets=b"ab")
    assert built(dissect.layers.S7_SZLHead(szl_id=0x19), led, led)[:23] == "00 19 00 00 00 04 00 02"
    assert built(dissect.layers.S7_SZLHead(szl_id=0x19), led, rest, led, rest)[:23] == "00 19 00 00 00 06 00 02"


def test_what_a_service_needs_stands_before_its_name() -> None:
    block = dissect.layers.S7_PIBlock(block_type="08", block_number="00020")
    parts = [dissect.layers.S7_PIHead(), dissect.layers.S7_PIBlocks(), block, block]
    octets = bytes(S7_Job(parameters=[*parts, dissect.layers.S7_PIName(service="_INSE")]))
    assert octets[8:] == b"\x00\x12\x02\x0008000" + b"20P0800020P" + b"\x05_INSE"


def test_a_password_is_encoded() -> None:
    password = dissect.layers.S7_Password.of("secret")
    assert dissect.protocols.s7.security.decode_password(password.password) == b"secret  "
    with pytest.raises(ValueError, match="up to 8 bytes"):
        dissect.layers.S7_Password.of("secretsecret")


# ---- showing ---------------------------------------------------------------------------------------------------------


def test_octets_that_say_something_show_it() -> None:
    clock = dissect.layers.S7_Clock(time_=bytes.fromhex("2402291200000005"))
    assert "time_     = DT#2024-02-29-12:00:00.000 (2402291200000005)" in shown(clock)
    assert "DT#" not in shown(dissect.layers.S7_Clock())
    assert "user      = PLC 1\n" in shown(dissect.layers.S7_MessageRequest(user="PLC 1"))
    assert "user      = 414243444546474849\n" in shown(dissect.layers.S7_MessageRequest(user="ABCDEFGHI"))


def test_octets_of_another_size_than_their_field() -> None:
    assert bytes(dissect.layers.S7_MessageRequest(user="PLC 1"))[2:] == b"PLC 1\0\0\0"
    with pytest.raises(ValueError, match="user is 8 byte"):
        bytes(dissect.layers.S7_MessageRequest(user="ABCDEFGHI"))
