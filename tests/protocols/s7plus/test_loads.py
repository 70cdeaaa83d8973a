"""What a request loads: blocks, types, texts and containers, named and counted as an engineer does."""

from __future__ import annotations

from typing import Final

import pytest

from dissect.protocols.s7plus.contents import VariableAddress
from dissect.protocols.s7plus.loads import FIRMWARE, LOADED, PROTECTED, load_text, number_of, said, written_as
from dissect.protocols.s7plus.objects import Attribute, Element, PlusObject, every_object
from dissect.protocols.s7plus.value_tables import UINT, WSTRING
from dissect.protocols.s7plus.values import Value

#: Attributes of a block, and classes.
NAME: Final = 233
NUMBER: Final = 2521
LANGUAGE: Final = 2523
DB: Final = 2574
FC: Final = 2579
UDT: Final = 3932
OB: Final = 2647
TYPE: Final = 511
PROGRAM_CLASS: Final = 2520
HARDWARE_CLASS: Final = 2496
TEXTS: Final = 4672
ROOT: Final = 1
PROGRAM: Final = 3


class Made:
    """Objects, each at a place of its own, as in a request."""

    def __init__(self) -> None:
        self.count = 0

    def __call__(
        self, class_id: int, number: int = -1, name: str = "", language: int = -1, rid: int = 211, *inside: PlusObject
    ) -> PlusObject:
        elements: list[Element] = [Attribute(NUMBER, Value(0, UINT, number))] if number >= 0 else []
        if name:
            elements.append(Attribute(NAME, Value(0, WSTRING, name)))
        if language >= 0:
            elements.append(Attribute(LANGUAGE, Value(0, UINT, language)))
        one = PlusObject(rid, class_id, 0, 0, 0, [*elements, *inside])
        self.count += 1
        one.offset = self.count
        return one


make = Made()


def loaded(parent: int, *tops: PlusObject, unread: bool = False) -> str:
    return load_text(parent, list(tops), every_object(list(tops)), unread)


@pytest.mark.parametrize(
    ("one", "number", "text"),
    [
        (make(DB, 3), 3, "DB3"),
        (make(DB, 0), 0, "DB0"),
        (make(DB, 3, "tank"), 3, "DB3 'tank'"),
        (make(DB, 3, "DB3"), 3, "DB3"),
        (make(FC, 7, "pump", 4), 7, "FC7 'pump' (SCL)"),
        (make(FC, 7, "pump", 1), 7, "FC7 'pump' (STL)"),
        (make(FC, 7, "pump", 0), 7, "FC7 'pump'"),  # its language is undefined
        (make(DB, -1, "", -1, 0x8A0E0009), 9, "DB9"),
        (make(DB, 3, "", -1, 0x8A0E0009), 3, "DB3"),  # the attribute counts
        (make(DB, -1, "x"), -1, "DB 'x'"),
        (make(7777, 4), 4, "7777 4"),
        (make(7777, -1, "x"), -1, "7777 'x'"),
        (make(PROGRAM_CLASS, 0), 0, "PLCProgram 0"),
        (make(PROGRAM_CLASS), -1, "PLCProgram"),
    ],
)
def test_an_object_has_the_name_of_a_block(one: PlusObject, number: int, text: str) -> None:
    assert number_of(one) == number
    assert said([one]) == text


def test_five_objects_are_named_and_the_others_counted() -> None:
    blocks = [make(DB, number) for number in range(1, 7)]
    assert said([]) == ""
    assert said(blocks[:5]) == "DB1, DB2, DB3, DB4, DB5"
    assert said(blocks) == "DB1, DB2, DB3, DB4, DB5 and 1 more"


def test_blocks_in_the_program_are_named_as_they_were_sent() -> None:
    """Types and all else that stands beside them are among them."""
    assert loaded(PROGRAM, make(DB, 3), make(OB, 1)) == "DB3, OB1"
    assert loaded(PROGRAM, make(TYPE), make(DB, 3)) == "ClassTypeInfo, DB3"
    assert loaded(PROGRAM) == "objects that were not read"
    assert loaded(PROGRAM, make(DB, 3), unread=True) == "DB3 and more that was not read"
    assert loaded(PROGRAM, unread=True) == "objects that were not read and more that was not read"


def test_what_belongs_to_no_program_is_no_load() -> None:
    assert loaded(ROOT, make(1001)) == ""
    assert loaded(ROOT, make(TYPE)) == ""
    assert loaded(ROOT) == ""
    assert loaded(285, make(287), unread=True) == ""


@pytest.mark.parametrize(
    ("class_id", "text"),
    [(HARDWARE_CLASS, "the hardware configuration"), (PROGRAM_CLASS, "the program"), (TEXTS, "1 text container")],
)
def test_a_container_alone_is_a_load(class_id: int, text: str) -> None:
    assert loaded(ROOT, make(class_id)) == text
    assert loaded(ROOT, make(1001), make(class_id)) == text


def test_a_program_is_loaded_with_all_that_is_in_it() -> None:
    inside = [make(UDT, 9), make(TYPE), make(TYPE), make(DB, 3), make(OB, 1, "Main"), make(FC, 7)]
    program = make(PROGRAM_CLASS, -1, "", -1, 211, *inside)
    texts = [make(TEXTS), make(TEXTS)]
    assert loaded(ROOT, make(HARDWARE_CLASS), program, *texts) == (
        "the hardware configuration, the program, 2 descriptions of types, 2 text containers, "
        "3 blocks and 1 type: OB1 'Main', FC7, DB3, UDT9"
    )
    assert loaded(ROOT, program, unread=True).endswith("UDT9 and more that was not read")
    assert loaded(ROOT, make(PROGRAM_CLASS, -1, "", -1, 211, make(TYPE))) == "the program, 1 description of a type"


def test_descriptions_of_types_count_with_a_program_or_blocks() -> None:
    """Beside a hardware configuration alone they describe something else."""
    assert loaded(ROOT, make(DB, 3), make(TYPE)) == "1 description of a type, DB3"
    assert loaded(ROOT, make(HARDWARE_CLASS), make(TYPE)) == "the hardware configuration"


@pytest.mark.parametrize(
    ("blocks", "text"),
    [
        ([DB], "DB1"),
        ([UDT], "UDT1"),
        ([DB, OB], "2 blocks: OB2, DB1"),
        ([UDT, DB], "1 block and 1 type: DB2, UDT1"),
        ([UDT, UDT], "2 types: UDT1, UDT2"),
        ([3935, 3934, 3933, UDT, DB, FC, 2578, OB], "4 blocks and 4 types: OB8, FB7, FC6, DB5, UDT4 and 3 more"),
        ([3935, 3934, 3933], "3 types: FBT3, SDT2, FCT1"),
    ],
)
def test_blocks_with_code_are_named_first(blocks: list[int], text: str) -> None:
    assert loaded(ROOT, *[make(class_id, number) for number, class_id in enumerate(blocks, 1)]) == text


def test_blocks_inside_others_are_counted_in_the_program_as_well() -> None:
    library = make(7777, -1, "", -1, 211, make(DB, 3), make(FC, 4))
    assert loaded(PROGRAM, library) == "2 blocks: FC4, DB3"
    assert loaded(PROGRAM, make(DB, 3), library) == "3 blocks: FC4, DB3, DB3"


@pytest.mark.parametrize(
    ("address", "kind", "text"),
    [
        (VariableAddress(0, 0x8A0E0003, 2533, []), LOADED, "DB3 (BodyDescription)"),
        (VariableAddress(0, 0x8A120003, 2580, []), LOADED, "FB3 (Code)"),
        (VariableAddress(0, 0x8A0E0003, 2544, [1]), LOADED, "DB3 (InterfaceDescription)"),
        (VariableAddress(0, 0x8A0E0003, 4578, []), LOADED, "DB3 (TypeInfo)"),
        (VariableAddress(0, 0x8A0E0003, 2550, [9]), "", ""),
        (VariableAddress(0, 50, 2533, []), "", ""),  # no block
        (VariableAddress(0, 50, 3451, []), PROTECTED, "CPUcommon.CPUProtectionLevel"),
        (VariableAddress(0, 50, 7, [7918]), PROTECTED, "CPUcommon.CPUPassword"),
        (VariableAddress(0, 50, 7, [8, 7918]), PROTECTED, "CPUcommon.CPUPassword"),
        (VariableAddress(0, 50, 7, [7918, 8]), "", ""),
        (VariableAddress(0, 0x8A0E0003, 2550, [3451]), "", ""),  # a LID, and an index
        (VariableAddress(0, 82, 3736, [3451]), "", ""),
        (VariableAddress(0, 16, 7, []), FIRMWARE, "FWpackage.7"),
        (VariableAddress(0, 17, 7, []), "", ""),
    ],
)
def test_which_written_attributes_are_loads(address: VariableAddress, kind: str, text: str) -> None:
    assert written_as(address) == (kind, text)
