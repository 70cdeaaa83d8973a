"""What an error code means, which depends on the function that it answers."""

from __future__ import annotations

from typing import Final

import pytest

from dissect.protocols.s7.errors import (
    ERROR_CLASSES,
    ERROR_CODES,
    ERROR_SERVICES,
    NO_FUNCTION,
    class_names,
    errors_of,
    may_protect,
    protects,
)
from dissect.protocols.s7.tables import FUNCTIONS
from tests.cases import each

READ: Final = 0x04
WRITE: Final = 0x05
USERDATA: Final = 0x00
UPLOADS: Final = (0x1D, 0x1E, 0x1F)
BLOCKS: Final = (0x1A, 0x1B, 0x1C, *UPLOADS, 0x28, USERDATA)
EVERY: Final = [NO_FUNCTION, 0x99, *[row.number for row in FUNCTIONS]]

#: Codes whose names say something of blocks, and the functions of which they may.
OF_BLOCKS: Final = {0x8003: BLOCKS, 0x8205: BLOCKS, 0x8304: UPLOADS, 0x8306: BLOCKS, 0x8307: BLOCKS, 0x8401: BLOCKS}


@each(("function", "number"), [(function, row.number) for function in EVERY for row in ERROR_CODES])
def test_a_name_that_fits_the_function(function: int, number: int) -> None:
    codes = errors_of(function)
    if function in OF_BLOCKS.get(number, (function,)):
        assert (codes.name(number), codes.text(number)) == (ERROR_CODES.name(number), ERROR_CODES.text(number))
        assert number in codes
    else:
        words = ERROR_CLASSES.name(number >> 8)
        assert number not in codes
        if number >> 8 in ERROR_CLASSES:
            assert codes.name(number) == f"{words} (error class 0x{number >> 8:02x})"
        assert ERROR_CODES.name(number) not in codes.coded(number)


def test_every_code_has_a_class_or_service() -> None:
    uppers = {row.number >> 8 for row in ERROR_CODES}
    assert uppers == {row.number for table in (ERROR_CLASSES, ERROR_SERVICES) for row in table}
    assert not set(ERROR_CLASSES.names()) & set(ERROR_SERVICES.names())
    assert len(class_names()) == len(uppers) - 1  # but no error


@each("function", EVERY)
def test_an_unknown_code_has_the_words_of_its_class(function: int) -> None:
    codes = errors_of(function)
    for table in (ERROR_CLASSES, ERROR_SERVICES):
        for row in table:
            unknown = next(number for number in range(row.number << 8 | 0xFF, 0, -1) if number not in ERROR_CODES)
            assert unknown >> 8 == row.number
            known = codes.get(unknown)
            if not row.number:
                assert known is None  # 0x00ff names no error, and there is one
                assert codes.coded(unknown) == "0x00ff (unknown code)"
                continue
            assert known is not None
            assert codes.coded(unknown) == f"0x{unknown:04x} {row.name} (error class 0x{row.number:02x})"
            assert codes.name(unknown) in class_names()
            assert codes.text(unknown) == row.text != ""
            assert known.number == unknown


@pytest.mark.parametrize("number", [0x4242, 0x7777, 0x8600, 0xFF00])
def test_an_unknown_class_is_a_number(number: int) -> None:
    codes = errors_of(READ)
    assert (codes.name(number), codes.text(number), codes.get(number)) == (f"0x{number:04x}", "", None)
    assert codes.coded(number) == f"0x{number:04x} (unknown code)"


def test_where_the_function_is_not_known_both_are_said() -> None:
    codes = errors_of(NO_FUNCTION)
    assert codes.coded(0x8304) == "0x8304 no resources (error class 0x83)"
    assert codes.text(0x8304).endswith(" As the answer to an upload: No further parallel upload.")
    assert codes.text(0x8205).endswith(" As the answer to a function on blocks: Copied block exists, not linked.")
    assert errors_of(WRITE).text(0x8304) == ERROR_CLASSES.text(0x83)


def test_one_table_for_each_kind() -> None:
    assert errors_of(0x29) is errors_of(0xF0)
    assert errors_of(READ) is errors_of(READ)
    assert len({id(errors_of(function)) for function in range(-1, 0x200)}) <= 16


@each("number", [row.number for row in ERROR_CODES] + [0x8181, 0x82FF, 0x83FF, 0x84FF, 0x85FF, 0x8600, 0x87FF])
def test_what_may_be_protection(number: int) -> None:
    for function in EVERY:
        perhaps = function in {READ, WRITE} and 0x8100 <= number < 0x8600
        assert may_protect(number, function) is perhaps
    assert protects(number) is (number in {0xD241, 0xD602})
