"""What ids are called, alone and in addresses."""

from __future__ import annotations

import pytest

from dissect.protocols.s7plus.contents import VariableAddress, known_address
from dissect.protocols.s7plus.id_tables import IDS
from dissect.protocols.s7plus.ids import (
    SECRETS,
    block_kind,
    block_name,
    id_name,
    is_packed,
    is_secret,
    member_id,
    member_name,
    plain_id,
    short_name,
)


@pytest.mark.parametrize(
    ("number", "name"),
    [
        (233, "233 ObjectVariableTypeName"),
        (52, "52 NativeObjects.theCPUexecUnit_Rid"),
        (3, "3 NativeObjects.thePLCProgram_Rid"),
        (0x8A0E0003, "DB3"),
        (0x8A0EFFFF, "DB65535"),
        (0x8A120007, "FB7"),
        (0x8A130007, "FC7"),
        (0x8A320001, "OB1"),
        (0x89FD0002, "UDT2"),
        (0x8A200430, "FB1072"),
        (0x8A240430, "UDT1072"),
        (0x92000003, "type of DB3 0x92000003"),
        (0x9101FFFF, "type of UDT65535 0x9101ffff"),
        (0x93000001, "type of FB1 0x93000001"),
        (0x94000001, "type of FC1 0x94000001"),
        (0x95000001, "type of OB1 0x95000001"),
        (0x96000001, "0x96000001"),
        (0x90010000, "0x90010000"),
        (0x020A0010, "String[16]"),
        (0x020A00FE, "String[254]"),
        (0x020B0010, "0x020b0010"),
        (0x70000E51, "0x70000e51"),
        (960, "960"),
        (0xFFFF, "65535"),
        (0x10000, "0x00010000"),
        (0x8A0D0003, "0x8a0d0003"),
        (0x89FC0003, "0x89fc0003"),
    ],
)
def test_an_id_is_its_name_or_its_number(number: int, name: str) -> None:
    assert id_name(number) == name
    if number != 3:  # as a member, the first five are places of memory
        assert member_id(number) == name
    assert (block_name(number) == name) == (name[0] in "DFOU")
    assert short_name(number) in name


def test_members_of_memory_have_names_of_their_own() -> None:
    assert member_id(3) == "3 LID_OMS_STB_ClassicBlob"
    assert plain_id(3) == "3"


@pytest.mark.parametrize(
    ("number", "short", "member"),
    [
        (233, "ObjectVariableTypeName", "ObjectVariableTypeName"),
        (2167, "CPUexecUnit.OperatingStateREQ", "OperatingStateREQ"),
        (52, "CPUexecUnit", "52"),
        (105, "EventRid.PeripheralAccessErrorEventData", "105"),
        (1001, "ClassSubscription", "1001"),
        (2681, "DAI", "2681"),
        (8081, "UserCredentials.UserConfData", "UserConfData"),
        (8053, "ReleaseMngmt.ESreleasesFingerprint", "ESreleasesFingerprint"),
        (1845, "1845", "1845"),
    ],
)
def test_a_name_in_a_line_has_no_prefixes(number: int, short: str, member: str) -> None:
    assert (short_name(number), member_name(number)) == (short, member)


def test_each_kind_of_block_has_a_class() -> None:
    """The class says what an object is, whatever its id is; without a class it is none."""
    named = {row.number: row.name.removesuffix(".Class_Rid") for row in IDS if row.name.endswith(".Class_Rid")}
    blocks = {class_id: block_kind(211, class_id) for class_id in named if block_kind(211, class_id)}
    assert blocks == {2574: "DB", 2578: "FB", 3932: "UDT", 2647: "OB"}
    assert {named[class_id].removeprefix("ProgramCycle") for class_id in blocks} == set(blocks.values())
    assert [block_kind(211, class_id) for class_id in range(3931, 3937)] == ["", "UDT", "FBT", "SDT", "FCT", ""]
    assert [block_kind(211, class_id) for class_id in range(2577, 2581)] == ["", "FB", "FC", ""]
    assert block_kind(0x8A0E0003, 7) == "DB"
    assert block_kind(0x8A0E0003, 2578) == "DB"
    assert block_kind(0x8A0E0003, 0) == ""
    assert block_kind(0x8A0D0003, 7) == ""
    assert block_kind(0x89FD0000, 7) == "UDT"


def test_a_class_of_organization_blocks_is_one_for_each_event() -> None:
    """22 in a row, the class on which they build, and two of motion control."""
    classes = [class_id for class_id in range(2500, 5000) if block_kind(211, class_id) == "OB"]
    assert (len(classes), classes[0], classes[-2:]) == (25, 2610, [4637, 4639])
    assert classes[1:-2] == list(range(classes[1], classes[1] + 22))
    assert 2647 in classes


def test_secrets_are_known_by_their_ids() -> None:
    for number in [*range(9000), 0x8A0E0003, 2**32 - 1, -1, -2]:
        assert is_secret(number) == (number in SECRETS)
    words = ("Password", "Response", "Legitimate", "Key", "ProtectionLevel", "UserConf")
    assert all(any(word in IDS.name(number) for word in words) for number in SECRETS)
    assert {row.number for row in IDS if row.name.rpartition(".")[2].startswith(("Password", "CPUPassword"))} <= SECRETS


@pytest.mark.parametrize(
    ("low", "high"), [(0x90000000, 0x9FFFFFFF), (0x02000000, 0x02FFFFFF)], ids=["of the program", "of libraries"]
)
def test_structures_of_the_program_are_sent_as_octets(low: int, high: int) -> None:
    assert [is_packed(number) for number in (low - 1, low, low + 1, high - 1, high, high + 1)] == [
        False, False, True, True, False, False
    ]  # fmt: skip


# ---- addresses ------------------------------------------------------------------------------------------------------

DB3 = 0x8A0E0003


@pytest.mark.parametrize(
    ("area", "sub_area", "lids", "crc", "label", "bit"),
    [
        (82, 3736, [3, 100, 1], 0, "MB100", 800),
        (82, 3736, [3, 100, 2], 0, "MW100", 800),
        (82, 3736, [3, 100, 4], 0, "MD100", 800),
        (82, 3736, [3, 100, 3], 0, "MB100 x3", 800),
        (82, 3736, [3, 100, 8], 0, "MB100 x8", 800),
        (80, 3736, [3, 4, 1, 5], 0, "I4.5", 37),
        (81, 3736, [3, 0, 1, 0], 0, "Q0.0", 0),
        (83, 3736, [3, 7, 2], 0, "CW7", 56),
        (84, 3736, [3, 7, 2], 0, "TW7", 56),
        (DB3, 2550, [3, 10, 2], 0, "DB3.DBW10", 80),
        (DB3, 2550, [3, 10, 20], 0, "DB3.DBB10 x20", 80),
        (DB3, 2550, [3, 10, 1, 7], 0, "DB3.DBX10.7", 87),
        # Symbols, and what only looks like an absolute address.
        (DB3, 2550, [14], 0xAB, "DB3 LID 14 [CRC 0x000000ab]", -1),
        (DB3, 2550, [3, 10, 2], 1, "DB3 LID 3.10.2 [CRC 0x00000001]", -1),
        (DB3, 2550, [3, 10], 0, "DB3 LID 3.10", -1),
        (DB3, 2550, [3, 10, 2, 1, 1], 0, "DB3 LID 3.10.2.1.1", -1),
        (DB3, 2550, [4, 10, 2], 0, "DB3 LID 4.10.2", -1),
        (0x8A120003, 2550, [3, 10, 2], 0, "FB3 LID 3.10.2", -1),
        (DB3, 2548, [9], 0, "DB3 ValueInitial LID 9", -1),
        (DB3, 2550, [], 0, "DB3", -1),
        (DB3, 2544, [], 0, "DB3 InterfaceDescription", -1),
        (52, 2237, [3486], 0, "CPUexecUnit.DIS.OperatingState", -1),
        (52, 2237, [3, 1, 2], 0, "CPUexecUnit.DIS.3.1.2", -1),
        (85, 3736, [3, 100, 2], 0, "RuntimeMeters.ValueActual.3.100.2", -1),
        (0x70000001, 1053, [], 0, "0x70000001.SubscriptionCreditLimit", -1),
    ],
)
def test_an_address_is_written_as_people_write_it(
    area: int, sub_area: int, lids: list[int], crc: int, label: str, bit: int
) -> None:
    address = VariableAddress(crc, area, sub_area, lids)
    assert (address.label, address.start_bit) == (label, bit)
    assert address.label == label  # the same when it is asked for again
    assert label in repr(address)


def test_addresses_are_equal_if_all_their_numbers_are() -> None:
    one = VariableAddress(1, 2, 3, [4])
    assert one == VariableAddress(1, 2, 3, [4])
    assert hash(one) == hash(VariableAddress(1, 2, 3, [4]))
    others = [VariableAddress(0, 2, 3, [4]), VariableAddress(1, 0, 3, [4]), VariableAddress(1, 2, 0, [4])]
    others += [VariableAddress(1, 2, 3, []), VariableAddress(1, 2, 3, [4, 5])]
    assert all(one != other for other in others)
    assert one != (1, 2, 3, 4)


def test_an_address_of_sixteen_numbers_is_remembered_and_a_longer_one_is_not() -> None:
    for count, known in ((0, True), (15, True), (16, True), (17, False), (40, False)):
        lids = list(range(100, 100 + count))
        first = known_address(7, 82, 3736, lids)
        assert (known_address(7, 82, 3736, list(lids)) is first) == known
        assert first == VariableAddress(7, 82, 3736, lids)
