"""What two dictionaries differ in; the level is always that of the two identities."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.scd.difference import Change, compare
from dissect.scd.source import parse_toml
from tests.scd.test_dump import EVERYTHING, PLANT

SOURCE = PLANT.read_text("utf-8")
OTHER = EVERYTHING
BASE = parse_toml(SOURCE)


def changed(*replacements: str, source: str = SOURCE) -> tuple[str, tuple[Change, ...]]:
    text = source
    for replacement in replacements:
        old, _, new = replacement.partition(" ⇒ ")
        assert old in text
        text = text.replace(old, new)
    found = compare(parse_toml(source), parse_toml(text))
    return found.level, found.changes


def test_the_same() -> None:
    assert changed() == ("same", ())
    assert changed(source=OTHER) == ("same", ())


@pytest.mark.parametrize(
    ("replacement", "changes"),
    [
        ('"1.0.0" ⇒ "1.0.1"', [Change("dictionary", "version", "1.0.0", "1.0.1", False)]),
        ('name = "Журнал" ⇒ name = "Log"', [Change("object 0x2003", "name", "Журнал", "Log", False)]),
        ("low = -3000 ⇒ low = -4000", [Change("type 0x0040", "field 4 low", "-3000", "-4000", False)]),
        ("low = -3000 ⇒ low = -3000.0", [Change("type 0x0040", "field 4 low", "-3000", "-3000.0", False)]),
        ('1 = "сухой ход" ⇒ 3 = "dry"', [Change("type 0x0041", "field 2 text 1", "сухой ход", None, False),
                                          Change("type 0x0041", "field 2 text 3", None, "dry", False)]),
    ],
)  # fmt: skip
def test_names(replacement: str, changes: list[Change]) -> None:
    assert changed(replacement) == ("names", tuple(changes))


@pytest.mark.parametrize(
    ("replacement", "changes"),
    [
        ("bits = 12 ⇒ bits = 10", [Change("type 0x0060", "bits", "12", "10", True),
                                   Change("object 0x1a01", "entry 3", "0x6001:0, 12 bits at 4", None, True),
                                   Change("object 0x1a41", "entry 4", "0x6800:4, 16 bits at 16", None, True)]),
        ("scale = 0.5 ⇒ scale = 0.25", [Change("object 0x6001", "scale", "0.5", "0.25", True),
                                       Change("object 0x6801", "scale", "0.5", "0.25", True)]),
        ("values = [100, 250, 400] ⇒ values = [100, 250, 401]", [Change("object 0x2001", "value 3", "400", "401", True)]),
    ],
)  # fmt: skip
def test_wire(replacement: str, changes: list[Change]) -> None:
    level, found = changed(replacement)
    assert level == "wire"
    for one in changes:
        assert any(
            (row.place, row.key, row.wire) == (one.place, one.key, one.wire) and one.before in {None, row.before}
            for row in found
        ), one


def test_entries_of_a_mapping_as_canopen_has_it() -> None:
    narrow = 'entries = "uint32"\nmap = ["0x6041:0", {reserved = 8}]\n'
    source = SOURCE.replace('map = ["0x6041:0", "0x6044:0", "0x6061:0"]\n', narrow)
    level, found = changed("{reserved = 8} ⇒ {reserved = 9}", source=source)
    told = ("wire", "entry 2", "a gap (0x50008), 8 bits", "a gap (0x50009), 9 bits")
    assert (level, found[0].key, found[0].before, found[0].after) == told


def test_what_only_one_has() -> None:
    without = SOURCE[: SOURCE.index("[[object]]\nindex = 0x2003")] + SOURCE[SOURCE.index("[[object]]\ndevice") :]
    found = compare(BASE, parse_toml(without))
    assert (found.level, found.changes) == ("wire", (Change("object 0x2003", "", "Журнал", None, True),))
    back = compare(parse_toml(without), BASE)
    assert back.changes == (Change("object 0x2003", "", None, "Журнал", True),)


def test_the_envelope_and_error_texts() -> None:
    assert changed("init=0xFFFF ⇒ init=0", source=OTHER) == (
        "wire", (Change("envelope", "crc init", "65535", "0", True),)
    )  # fmt: skip
    assert changed("нет объекта ⇒ nothing", source=OTHER) == (
        "names", (Change("error -5", "text", "нет объекта", "nothing", False),)
    )  # fmt: skip
    level, found = changed('[errors]\n"-5" = "нет объекта"\n ⇒ ', source=OTHER)
    assert (level, found) == ("names", (Change("error -5", "", "нет объекта", None, False),))


REPLACED = (
    '"pump_t" ⇒ "other_t"', '"run" ⇒ "go"', "reserved = 6 ⇒ reserved = 14", '"кПа" ⇒ "kPa"', "bits = 12 ⇒ bits = 9",
    'access = "const" ⇒ access = "ro"', "mandatory = true ⇒ mandatory = false", "default = 0x0237 ⇒ default = 1",
    'name = "Насосная" ⇒ name = "X"', "size = 32 ⇒ size = 33", "version = 1\n ⇒ version = 2\n", "high = 3000 ⇒ high = 1",
    "devices = [0, 1] ⇒ devices = [0, 2]", "scale = 0.5 ⇒ shift = 0.5", '0 = "стоп" ⇒ 0 = "stop"',
    'class = "DOMAIN" ⇒ type = "block"',
)  # fmt: skip


@given(st.sets(st.sampled_from(REPLACED)), st.sets(st.sampled_from(REPLACED)))
def test_the_changes_say_what_the_identities_say(first: set[str], second: set[str]) -> None:
    sources = []
    for replacements in (first, second):
        text = SOURCE
        for replacement in sorted(replacements):
            old, _, new = replacement.partition(" ⇒ ")
            text = text.replace("run" if old == '"run"' else old, "go" if old == '"run"' else new)
        sources.append(parse_toml(text))
    found = compare(*sources)
    assert found.level == (
        "same" if not found.changes else "wire" if any(one.wire for one in found.changes) else "names"
    )
