"""Files of bindings: what is right, and each mistake once, told with its line, its table and what to do."""

from __future__ import annotations

from collections.abc import Callable
from ipaddress import ip_network
from pathlib import Path
from typing import Final

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dissect import scd
from dissect.meaning.bindings.binding import Binding, Bindings
from dissect.meaning.bindings.bindings_file import MAX_BINDINGS, MAX_FILE, BindingError, load_bindings
from dissect.scd.dictionary import Dictionary
from dissect.scd.source import parse_toml
from tests.cases import each

PLANT: Final = Path(__file__).resolve().parents[3] / "captures" / "scd" / "plant.toml"
OD: Final = scd.compile(PLANT)
#: The envelope of these messages tells no size.
UNFRAMED: Final = '[dictionary]\nname="u"\n[envelope]\nfields=[{role="index",type="uint16"},{role="data"}]\n'

Load = Callable[..., Bindings]


@pytest.fixture
def load(tmp_path: Path) -> Load:
    """Read the bindings of a text."""

    def read(text: str | bytes, dictionary: Dictionary = OD) -> Bindings:
        path = tmp_path / "x.toml"
        path.write_bytes(text.encode() if isinstance(text, str) else text)
        return load_bindings(path, dictionary)

    return read


def table(*lines: str) -> str:
    return "[[binding]]\n" + "\n".join(lines) + "\n"


def one(load: Load, *lines: str) -> Binding:
    (binding,) = load(table(*lines)).all
    return binding


def test_bindings_of_the_plant() -> None:
    found = load_bindings(PLANT.with_name("plant.bind.toml"), OD)
    assert [(row.carrier, row.holds, row.key, row.size) for row in found.all] == [
        ("udp", "messages", "", 0),
        ("udp", "pdo", "T2", 4),
        ("tcp", "messages", "", 0),
        ("cotp", "messages", "", 0),
        ("s7", "struct", "pump_t", 3),
        ("s7", "pdo", "T1", 7),
        ("bsend", "messages", "", 0),
    ]
    assert (sorted(found.udp), sorted(found.tcp), list(found.cotp), list(found.bsend)) == (
        [5600, 5602], [5601], [b"SCD1"], [0x5CD],
    )  # fmt: skip
    assert [row.offset for row in found.s7[0x84, 10]] == [0, 8]


@pytest.mark.parametrize(
    ("lines", "name", "fields"),
    [
        (("udp = 5600",), "udp 5600", {"carrier": "udp", "port": 5600}),
        (("udp = 0x15E0", 'host = "10.0.0.5"'), "udp 5600 10.0.0.5", {"network": ip_network("10.0.0.5")}),
        (("tcp = 1", 'host = "10.0.0.0/24"'), "tcp 1 10.0.0.0/24", {"network": ip_network("10.0.0.0/24")}),
        (("tcp = 1", 'host = "fe80::1"'), "tcp 1 fe80::1", {"network": ip_network("fe80::1")}),
        (('tsap = "SCD1"',), 'TSAP "SCD1"', {"carrier": "cotp", "tsap": b"SCD1"}),
        (('tsap = "0x0102"',), "TSAP 0x0102", {"tsap": b"\1\2"}),
        (("tsap = [1, 0x02]",), "TSAP 0x0102", {"tsap": b"\1\2"}),
        (("bsend = 0x1234",), "BSEND 0x00001234", {"carrier": "bsend", "r_id": 0x1234}),
        (
            ('s7 = "DB10.DBB4"', "size = 64"),
            "DB10.DBB4",
            {"carrier": "s7", "area": 0x84, "db": 10, "offset": 4, "size": 64},
        ),
        (('area = "DB"', "db = 10", "offset = 4", "size = 64"), "DB10.DBB4", {"area": 0x84, "db": 10, "offset": 4}),
        (('area = "M"', "offset = 4", "size = 64"), "MB4", {"area": 0x83, "db": 0, "offset": 4}),
        (("udp = 1", 'device = "peer"', 'name = "насос"'), "насос", {"device": "peer"}),
    ],
)
def test_places(load: Load, lines: tuple[str, ...], name: str, fields: dict[str, object]) -> None:
    binding = one(load, *lines, 'holds = "messages"')
    assert (binding.name, binding.holds) == (name, "messages")
    assert {key: getattr(binding, key) for key in fields} == fields


@pytest.mark.parametrize(
    ("written", "content"),
    [
        ("T1", ("pdo", "T1", "T1 Состояние 1", (0, 0), 7)),
        ("TPDO 65", ("pdo", "T65", "T65 Состояние 2", (0, 0), 7)),
        ("r65", ("pdo", "R65", "R65 Команда 2", (0, 0), 3)),
        ("Насос и давление 1", ("pdo", "T2", "T2 Насос и давление 1", (0, 0), 4)),
        ("0x1A00", ("object", "0x1a00", "0x1a00 Состояние 1", (0x1A00, 0), 24)),
        ("pump_t", ("struct", "pump_t", "pump_t", (0x40, 0), 3)),
        ("0x0041", ("struct", "alarm_t", "alarm_t", (0x41, 0), 41)),
        ("Насос 1", ("object", "0x6000", "0x6000 Насос 1", (0x6000, 0), 3)),
        ("0x6000:1", ("value", "0x6000:1", "0x6000:1 Насос 1.run", (0x6000, 1), 1)),
        ("Насос 2.speed", ("value", "0x6800:4", "0x6800:4 Насос 2.speed", (0x6800, 4), 2)),
        ("Давление 1", ("value", "0x6001:0", "0x6001:0 Давление 1", (0x6001, 0), 2)),
        ("0x6001", ("value", "0x6001:0", "0x6001:0 Давление 1", (0x6001, 0), 2)),
        ("Журнал", ("value", "0x2003:0", "0x2003:0 Журнал", (0x2003, 0), 0)),
    ],
)
def test_contents(load: Load, written: str, content: tuple[object, ...]) -> None:
    found = one(load, "udp = 1", f'holds = "{written}"')
    assert (found.holds, found.key, found.title, found.address, found.size) == content


def test_a_content_without_size_is_given_one(load: Load) -> None:
    assert one(load, "tcp = 1", 'holds = "Журнал"', "size = 9").size == 9
    assert one(load, 's7 = "DB1.DBB0"', 'holds = "Журнал"', "size = 9").size == 9
    assert one(load, 's7 = "DB1.DBB0"', 'holds = "T1"', "size = 7").size == 7
    assert one(load, "tcp = 1", 'holds = "T1"').size == 7


def test_messages_without_a_size_travel_where_units_end(load: Load) -> None:
    od = parse_toml(UNFRAMED)
    assert [row.name for row in load(table("udp = 1", 'holds = "messages"'), od).all] == ["udp 1"]
    with pytest.raises(BindingError, match="has no size field, so messages in a TCP stream cannot be separated"):
        load(table("tcp = 1", 'holds = "messages"'), od)


M: Final = 'holds = "messages"'


@each(
    ("text", "message"),
    [
        ("", "[[binding]]: 0 bindings, expected 1 to 1024"),
        ("[[bindings]]\n", "bindings: no such key here; close to it: 'binding'"),
        ("[binding]\nudp = 1\n", "[binding]: must be written as [[binding]]"),
        ("binding = [1]\n", "[[binding]] 1: 1 is not a table"),
        ("\n[[binding]]\nudp = = 1\n", ":3: TOML: Invalid value"),
        (table(M), ":1: [[binding]] 1, udp, tcp, tsap, s7, bsend: one of them is required"),
        (table("udp = 1", "tcp = 1", M), ":1: [[binding]] 1, udp, tcp: exclude each other: use one table for each"),
        (table("udp = 0", M), "udp: 0 is outside 1 to 65535"),
        (table("tcp = 65536", M), "tcp: 65536 is outside 1 to 65535"),
        (table("udp = true", M), "udp: True is not a whole number of at most 64 bits"),
        (table("bsend = 0x1_0000_0000", M), "bsend: 4294967296 is outside 0 to 4294967295"),
        (table('tsap = ""', M), "tsap: '' is not a TSAP: write 1 to 254 bytes"),
        (table('tsap = "0x010"', M), "tsap: '0x010' is not a TSAP"),
        (table('tsap = "Связь"', M), "tsap: 'Связь' is not a TSAP"),
        (table("tsap = [1, 256]", M), "tsap: [1, 256] is not a TSAP"),
        (table("tsap = [true]", M), "tsap: [True] is not a TSAP"),
        (table("tsap = 1", M), "tsap: 1 is not a TSAP"),
        (table('s7 = "DB10.DBX0.0"', M), "s7: 'DB10.DBX0.0' is not a byte address: write"),
        (table('area = "T"', M), "area: 'T' is not one of "),
        (table('area = "DB"', "offset = 0", M), "db: is missing"),
        (table('area = "M"', "db = 1", "offset = 0", "size = 12", M), "db: no such key here"),
        (table("udp = 1", "size = 9", M), "size: no such key here; these are: device, holds, host, name, udp"),
        (table("tcp = 1", "size = 9", M), "size: no such key here"),
        (table("udp = 1", 'host = "10.0.0"', M), "host: '10.0.0' is neither an address"),
        (table("udp = 1", 'host = "10.0.0.5/24"', M), "host: '10.0.0.5/24' is neither an address"),
        (table("udp = 1", 'device = "me"', M), "device: 'me' is not one of port, peer"),
        (table('s7 = "MB0"', 'device = "peer"', 'holds = "T1"'), "device: an S7 area is in the CPU"),
        (table("udp = 1", 'name = " "', M), "name: is empty"),
        (table("udp = 1"), "holds: is missing"),
        (table("udp = 1", 'holds = ""'), 'holds: is empty; write "messages", a PDO ("T1"), a struct or object'),
        (
            table("udp = 1", 'holds = "T9"'),
            "holds: no PDO T9 in the dictionary 'Насосная'; there are T1, T2, T65, T66, R1, R65",
        ),
        (table("udp = 1", 'holds = "pumpt"'), "in the dictionary 'Насосная'; close to it: 'pump_t'"),
        (table("udp = 1", 'holds = "message"'), "close to it: 'messages'"),
        (table("udp = 1", 'holds = "Давленье 2"'), "close to it: 'Давление 2'"),
        (table("udp = 1", 'holds = "Насос 1.sped"'), "'Насос 1' has no field 'sped'; close to it: 'speed'"),
        (table("udp = 1", 'holds = "Насос 3.speed"'), "close to it: 'Насос 2.speed', 'Насос 1.speed'"),
        (table("udp = 1", 'holds = "0x6000:3"'), "holds: sub-index 3 of 'Насос 1' is reserved"),
        (table("udp = 1", 'holds = "0x6002"'), "no PDO, struct or object '0x6002' in the dictionary"),
        (table("udp = 1", 'holds = "uint12"'), "no PDO, struct or object 'uint12' in the dictionary"),
        (table("udp = 1", 'holds = "0x0060"'), "no PDO, struct or object '0x0060' in the dictionary"),
        (table('s7 = "MB0"', M), "size: is missing: 'messages' has no size of its own"),
        (table("tcp = 1", 'holds = "Журнал"'), "size: is missing: 'Журнал' has no size of its own"),
        (table('s7 = "MB0"', "size = 4", 'holds = "pump_t"'), "size: 'pump_t' has 3 bytes, not 4"),
        (table('s7 = "MB0"', "size = 65536", M), "size: 65536 is outside 1 to 65535"),
        (table('s7 = "MB2097150"', 'holds = "pump_t"'), "size: it ends after byte 2097151"),
        (table("udp = 1", M, 'x = "\\u001b"'), "x: no such key here"),
    ],
)
def test_mistakes(load: Load, tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(BindingError) as caught:
        load(text)
    told = str(caught.value)
    assert told.startswith(str(tmp_path / "x.toml"))
    assert message in told
    assert told.isprintable()


def test_an_error_says_file_line_table_and_key(load: Load, tmp_path: Path) -> None:
    text = "# head\n" + table("udp = 1", M) + "\n" + table("udp = 2", 'holds = "T9"')
    with pytest.raises(BindingError) as caught:
        load(text)
    error = caught.value
    assert (error.path, error.line, error.key) == (str(tmp_path / "x.toml"), 8, "[[binding]] 2, holds")
    assert str(error).startswith(
        f"{tmp_path / 'x.toml'}:8: [[binding]] 2, holds: no PDO T9 in the dictionary 'Насосная'"
    )


@pytest.mark.parametrize(
    ("first", "second", "message"),
    [
        (("udp = 1", M), ("udp = 1", 'holds = "T1"'), "[[binding]] 2, udp: is already bound by [[binding]] 1, line 1"),
        (("udp = 1", 'host = "10.0.0.5"', M), ("udp = 1", 'host = "10.0.0.5/32"', M), "udp: is already bound by"),
        (("tcp = 1", 'name = "a"', M), ("tcp = 1", 'name = "b"', M), "tcp: is already bound by"),
        (('tsap = "AB"', M), ("tsap = [0x41, 0x42]", M), "tsap: is already bound by"),
        (("bsend = 1", M), ("bsend = 1", M), "bsend: is already bound by"),
        (
            ('s7 = "DB1.DBB0"', 'holds = "pump_t"'),
            ('s7 = "DB1.DBB2"', 'holds = "T1"'),
            "s7: overlaps bytes that are bound already, DB1.DBB0 to DB1.DBB2 by [[binding]] 1, line 1",
        ),
        (
            ('s7 = "DB1.DBB0"', 'holds = "pump_t"'),
            ('s7 = "DB1.DBB0"', 'holds = "T1"', 'host = "10.0.0.5"'),
            "s7: overlaps bytes that are bound already",
        ),
        (
            ("udp = 1", 'name = "a"', M),
            ("tcp = 1", 'name = "a"', M),
            "name: 'a' is already the name of [[binding]] 1, line 1",
        ),
        (("udp = 1", 'name = "tcp 1"', M), ("tcp = 1", M), "name: 'tcp 1' is already the name of [[binding]] 1"),
    ],
)
def test_two_for_one_place(load: Load, first: tuple[str, ...], second: tuple[str, ...], message: str) -> None:
    with pytest.raises(BindingError) as caught:
        load(table(*first) + table(*second))
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (("udp = 1", M), ("tcp = 1", M)),
        (("udp = 1", M), ("udp = 1", 'host = "10.0.0.5"', M)),
        (("udp = 1", 'host = "10.0.0.0/24"', M), ("udp = 1", 'host = "10.0.0.5"', M)),
        (("udp = 1", 'host = "fe80::/64"', M), ("udp = 1", 'host = "10.0.0.5"', M)),
        (('s7 = "DB1.DBB0"', 'holds = "pump_t"'), ('s7 = "DB1.DBB3"', 'holds = "pump_t"')),
        (('s7 = "DB1.DBB0"', 'holds = "pump_t"'), ('s7 = "DB2.DBB0"', 'holds = "pump_t"')),
        (
            ('s7 = "DB1.DBB0"', 'holds = "T1"', 'host = "10.0.0.4"'),
            ('s7 = "DB1.DBB0"', 'holds = "T2"', 'host = "10.0.0.5"'),
        ),
        (('s7 = "MB0"', 'holds = "T1"', 'host = "10.0.0.4"'), ('s7 = "MB0"', 'holds = "T2"', 'host = "fe80::1"')),
    ],
)
def test_two_that_are_apart(load: Load, first: tuple[str, ...], second: tuple[str, ...]) -> None:
    assert len(load(table(*first) + table(*second)).all) == 2


def test_one_name_for_two_things(load: Load) -> None:
    od = parse_toml(
        '[dictionary]\nname="u"\n'
        '[[type]]\nindex=0x40\nname="both"\nfields=[{name="x",type="uint8"}]\n'
        '[[object]]\nindex=0x2000\nname="both"\ntype="uint8"\n'
        '[[object]]\nindex=0x2001\nname="T1"\ntype="uint8"\n'
        '[[object]]\nindex=0x2002\nname="nothing"\nclass="NULL"\n'
        '[[pdo]]\ndir="T"\nnumber=1\nname="state"\nmap=["both"]\n'
        '[[pdo]]\ndir="T"\nnumber=2\nname="off"\nmap=[]\n'
    )
    for written, message in (
        ("both", '\'both\' is a struct and a value: write "0x0040" or "0x2000:0"'),
        ("T1", '\'T1\' is a pdo and a value: write "TPDO 1" or "0x2001:0"'),
        ("nothing", "0x2002 'nothing' is a NULL, which has no data"),
    ):
        with pytest.raises(BindingError) as caught:
            load(table("udp = 1", f'holds = "{written}"'), od)
        assert message in str(caught.value)
    for written, key in (("0x0040", "both"), ("0x2000:0", "0x2000:0"), ("TPDO 1", "T1"), ("state", "T1")):
        (binding,) = load(table("udp = 1", f'holds = "{written}"'), od).all
        assert binding.key == key
    with pytest.raises(BindingError, match="'off' has no size of its own"):
        load(table('s7 = "MB0"', 'holds = "off"'), od)


def test_files_that_are_none(load: Load, tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        load_bindings(tmp_path / "none.toml", OD)
    with pytest.raises(BindingError, match=r":2: byte 2: invalid UTF-8"):
        load(b"#\n\xff")
    with pytest.raises(BindingError, match=f"more than {MAX_FILE} bytes"):
        load(b"#" * (MAX_FILE + 1))
    with pytest.raises(BindingError, match=rf"{MAX_BINDINGS + 1} of them, expected {MAX_BINDINGS} at most"):
        load("[[binding]]\n" * (MAX_BINDINGS + 1))
    with pytest.raises(BindingError, match="nest at most"):
        load(table(M, "udp = " + "[" * 40 + "]" * 40))


def test_the_most_bindings(load: Load) -> None:
    text = "".join(table(f"udp = {port}", M) for port in range(1, MAX_BINDINGS + 1))
    assert len(load(text).udp) == MAX_BINDINGS


_PIECES: Final = st.sampled_from(
    ["udp", "tcp", "tsap", "s7", "area", "bsend", "db", "offset", "size", "host", "holds", "name", "device"]
)
_VALUES: Final = st.one_of(
    st.integers(-2, 70000).map(str),
    st.sampled_from(
        ['"messages"', '"T1"', '"pump_t"', '"DB1.DBB0"', '"M"', '"DB"', '"10.0.0.5"', '"0x6001"', '"0x"', "[1]", "{}"]
    ),
    st.text(st.characters(exclude_categories=["Cs", "Cc"], exclude_characters="'"), max_size=6).map(
        lambda text: f"'{text}'"
    ),
)


#: Bindings that are right, unless two of them are for the same port.
_SOUND: Final = st.fixed_dictionaries({"udp": st.integers(1, 65535).map(str), "holds": st.just('"messages"')})


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.dictionaries(_PIECES, _VALUES, max_size=6) | _SOUND, min_size=1, max_size=3))
def test_nothing_else_is_raised(load: Load, rows: list[dict[str, str]]) -> None:
    text = "".join(table(*(f"{key} = {value}" for key, value in row.items())) for row in rows)
    try:
        found = load(text)
    except BindingError:
        return
    assert len(found.all) == len(rows)
    assert len({row.name for row in found.all}) == len(rows)
