"""Every statement of the text, R1 to R108, has a test that names it: ``@pytest.mark.requirement("R27")``.

Here is the list that is kept, and what holds of the package as a whole: what it is for, how it is set up, what it keeps away
from. Statements about one module are with the tests of that module.
"""

from __future__ import annotations

import ast
import builtins
import random
import shutil
import socket
from collections.abc import Iterator
from ipaddress import IPv4Address
from pathlib import Path
from typing import Any, Final

import pytest

import dissect.scd
from dissect import scd
from dissect.scd import service
from dissect.scd.codec import Codec
from dissect.scd.errors import DictionaryError, Error
from dissect.scd.layout import Key
from dissect.scd.messages import Message
from dissect.scd.source import parse_toml
from dissect.scd.types import STANDARD, Value
from dissect.scd.values import NetTime
from tests.scd.test_examples import STATION

TESTS: Final = Path(__file__).resolve().parents[1]
PACKAGE: Final = Path(dissect.scd.__file__).parent
ALL: Final = {f"R{number}" for number in range(1, 109)}
VALUES: Final[dict[Key, Value]] = {(0x6000, 1): True, (0x6000, 2): False, (0x6001, 0): 0xABC, (0x6000, 4): -1500}


# The list


def marks(tree: ast.Module) -> Iterator[tuple[str, str]]:
    """Give (test, requirement) for every mark on a test."""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef) and node.name.startswith("test_"):
            for call in node.decorator_list:
                if isinstance(call, ast.Call) and ast.unparse(call.func) == "pytest.mark.requirement":
                    for name in call.args:
                        assert isinstance(name, ast.Constant), f"{node.name}: names of requirements are written out"
                        yield node.name, str(name.value)


def test_every_requirement_has_a_test_that_names_it() -> None:
    named: dict[str, list[str]] = {}
    for path in TESTS.rglob("test_*.py"):
        text = path.read_text("utf-8")
        if "mark.requirement(" in text:
            for test, name in marks(ast.parse(text)):
                named.setdefault(name, []).append(f"{path.name}::{test}")
    missing = sorted(ALL - named.keys(), key=lambda name: int(name[1:]))
    assert missing == []
    assert {name: tests for name, tests in named.items() if name not in ALL} == {}


def test_a_mark_is_found_where_it_is_and_nowhere_else() -> None:
    text = '@pytest.mark.requirement("R1", "R2")\n@other\ndef test_x(): ...\n@pytest.mark.requirement("R3")\ndef y(): ...\n'
    assert list(marks(ast.parse(text))) == [("test_x", "R1"), ("test_x", "R2")]


# What the package is, and what it keeps away from


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    """The dictionary of two participants: each has its own copy of one file."""
    parse_toml(STATION).save(tmp_path / "one.scd")
    shutil.copy(tmp_path / "one.scd", tmp_path / "other.scd")
    return tmp_path / "one.scd", tmp_path / "other.scd"


@pytest.mark.requirement("R1", "R2", "R9", "R11", "R12", "R18", "R56", "R97")
def test_two_participants_understand_each_other_by_the_dictionary_alone(files: tuple[Path, Path]) -> None:
    """Communication objects, types, rules of encoding, and the dictionary that has them all."""
    sender, receiver = (Codec(scd.load(path)) for path in files)
    assert sender.dictionary.file_id == receiver.dictionary.file_id
    sent = sender.objects("T1")
    sent.update(VALUES)
    received = receiver.objects()
    receiver.decode("T1", sender.encode("T1", sent), received)
    assert dict(received) == VALUES
    message = Message(service="write", phase="request", index=0x6000, sub=4, values={(0x6000, 4): 7})
    receiver.decode_message(sender.encode_message(message), received)
    assert received["Насос 1.speed"] == 7


@pytest.mark.requirement("R3")
@pytest.mark.parametrize("carrier", [bytes, bytearray, memoryview])
def test_a_message_is_the_same_whatever_carries_it(carrier: Any) -> None:
    """A datagram, a piece of a larger buffer, a stream that arrives in pieces of any size."""
    codec = Codec(parse_toml(STATION))
    request = codec.encode_message(Message(service="read", phase="request", tid=1, index=0x6001))
    push = codec.encode_message(Message(service="pdo", phase="push", tid=2, pdo="T1", values=VALUES))
    wanted = [codec.parse_message(octets) for octets in (request, push)]
    assert list(codec.parse_messages(carrier(request + push))) == wanted
    assert codec.parse_message(carrier(b"before" + push + b"after"), 6).values == VALUES
    for piece in (1, 5, 100):
        held, found = b"", []
        for at in range(0, len(request + push), piece):
            held += (request + push)[at : at + piece]
            while (size := codec.envelope.frame_size(carrier(held))) and size <= len(held):
                found.append(codec.parse_message(carrier(held[:size])))
                held = held[size:]
        assert (found, held) == (wanted, b"")


@pytest.mark.requirement("R4")
def test_nothing_but_the_octets_and_the_dictionary_decides() -> None:
    """What was sent or received before changes nothing: there is no session, no clock."""
    codec = Codec(parse_toml(STATION))
    units = [random.Random(number).randbytes(4) for number in range(50)]
    first = [codec.decode("T1", octets) for octets in units]
    for octets in units:
        codec.parse_message(octets)
    assert [codec.decode("T1", octets) for octets in reversed(units)] == first[::-1]
    assert Codec(parse_toml(STATION)).encode("T1", VALUES) == codec.encode("T1", VALUES) == codec.encode("T1", VALUES)


EXTENSION: Final = """
[[type]]
index = 0x0041
name = "valve_t"
fields = [{name="open", type="uint12"}, {name="moved", type="nettime"}]
[[object]]
index = 0x6002
name = "Задвижка"
class = "RECORD"
type = "valve_t"
[[pdo]]
dir = "T"
number = 2
map = ["Задвижка.open", "0x6002:2"]
"""


@pytest.mark.requirement("R5")
def test_a_device_is_added_by_description_alone() -> None:
    plain, extended = Codec(parse_toml(STATION)), Codec(parse_toml(STATION + EXTENSION))
    octets = extended.encode("T2", {"Задвижка.open": 0x123, "Задвижка.moved": NetTime(1, 2)})
    assert octets.hex(" ") == "23 11 00 00 00 20 00 00 00 00"
    assert extended.decode("T2", octets).values == {(0x6002, 1): 0x123, (0x6002, 2): NetTime(1, 2)}
    assert extended.decode_type("valve_t", octets).values == {"open": 0x123, "moved": NetTime(1, 2)}
    assert extended.encode("T1", VALUES) == plain.encode("T1", VALUES)
    with pytest.raises(Error, match="E_PDO_NUMBER"):
        plain.decode("T2", octets)


def imported() -> dict[str, set[str]]:
    """Return the modules that each file of the package imports, inside functions too."""
    found: dict[str, set[str]] = {}
    for path in PACKAGE.glob("*.py"):
        names = found.setdefault(path.name, set())
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Import):
                names.update(alias.name for alias in node.names)
            elif isinstance(node, ast.ImportFrom):
                names.update(
                    {node.module or ""}
                    if node.module != "dissect"
                    else {f"dissect.{alias.name}" for alias in node.names}
                )
    return found


@pytest.mark.requirement("R6")
def test_layer_6_knows_neither_what_carries_it_nor_what_it_is_for() -> None:
    for file, names in imported().items():
        ours = {name for name in names if name.split(".")[0] == "dissect"}
        assert {
            name
            for name in ours
            if name.split(".")[:2] not in (["dissect", "scd"], ["dissect", "config"], ["dissect", "wire"])
        } == set(), file


@pytest.mark.requirement("R3", "R7")
def test_encoding_and_decoding_call_no_carrier_and_open_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """C1: a codec. Whoever sends and receives its messages calls it, not it them."""
    carriers = {"socket", "ssl", "asyncio", "selectors", "http", "urllib", "scapy"}
    assert {file: names & carriers for file, names in imported().items() if names & carriers} == {}
    codec = Codec(parse_toml(STATION))
    codec.encode("T1", VALUES)  # what is imported on the first use is read from files

    def forbidden(*_: object, **__: object) -> None:
        raise AssertionError("a codec does no input or output")

    for home, name in ((socket, "socket"), (socket, "create_connection"), (builtins, "open"), (Path, "open")):
        monkeypatch.setattr(home, name, forbidden)
    again = Codec(codec.dictionary)
    octets = again.encode_message(Message(service="pdo", phase="push", pdo="T1", values=VALUES))
    assert again.decode_message(octets, again.objects()).values == VALUES


#: For every standard type a value of its own, and what looks like one and is of another kind.
TYPED: Final[dict[str, tuple[object, tuple[object, ...]]]] = {
    "bool": (True, (1, "true", None)),
    "int8": (-1, (True, 1.0, "1")),
    "int16": (-1, (True, 1.0, "1")),
    "int32": (-1, (True, 1.0, "1")),
    "int64": (-1, (True, 1.0, "1")),
    "uint8": (1, (True, 1.0, "1")),
    "uint16": (1, (True, 1.0, "1")),
    "uint32": (1, (True, 1.0, "1")),
    "uint64": (1, (True, 1.0, "1")),
    "float32": (1.5, (True, "1.5", None)),
    "float64": (1.5, (True, "1.5", None)),
    "string": ("a", (b"a", 1, None)),
    "block": (b"a", ("a", 1, None)),
    "interval": ((1, 1), (1, NetTime(1, 1), "1")),
    "nettime": ((1, 1), (1, 1.5, "now")),
    "mac": ("00:1B:44:11:3A:B7", ("00:1B", 1, b"1")),
    "ip": (IPv4Address("1.2.3.4"), ("1.2.3", 16909060, b"1")),
}


@pytest.mark.requirement("R8", "R19")
@pytest.mark.parametrize("kind", STANDARD.values(), ids=lambda kind: str(kind.name))
def test_objects_are_strictly_typed(kind: Any) -> None:
    size = "size = 4" if kind.variable else ""
    od = parse_toml(f'[dictionary]\nname="t"\n[[object]]\nindex=0x2000\nname="x"\ntype="{kind.name}"\n{size}\n')
    good, others = TYPED[kind.name]
    if kind.name == "block":
        good = b"abcd"
    objects = Codec(od).objects()
    objects["x"] = good
    before = dict(objects)
    for other in others:
        with pytest.raises(Error):
            objects["x"] = other
        with pytest.raises(Error):
            Codec(od).encode_value("x", other)
    assert dict(objects) == before


# The dictionary file


@pytest.mark.requirement("R10", "R13", "R14", "R15")
def test_the_codec_is_initialised_with_a_file(files: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(service, "_codec", None)
    objects = scd.init(str(files[0])).objects("T1")
    objects.update(VALUES)
    octets = scd.encode(objects)
    assert octets == bytes.fromhex("C1 AB 24 FA")
    received = scd.init(files[1]).objects("T1")
    assert scd.decode(octets, received) == tuple(VALUES)
    files[1].write_bytes(files[0].read_bytes()[:-1])
    with pytest.raises(DictionaryError):
        scd.init(files[1])
    assert scd.encode(received) == octets  # a codec that cannot be had leaves the one there is


@pytest.mark.requirement("R16", "R17")
def test_a_dictionary_is_an_ordinary_binary_file(files: tuple[Path, Path], tmp_path: Path) -> None:
    """It can be copied, renamed, write-protected; it is read as it is and never written to."""
    octets = files[0].read_bytes()
    assert b"\0" in octets
    with pytest.raises(UnicodeDecodeError):
        octets.decode()
    moved = files[0].rename(tmp_path / "конфигурация")
    moved.chmod(0o400)
    assert scd.load(moved).octets == scd.load(str(moved)).octets == moved.read_bytes() == octets
    with pytest.raises(FileNotFoundError):
        scd.load(files[0])


# Communication objects

NETWORK: Final = """
[dictionary]
name = "t"
[[object]]
index = 0x1000
name = "kind"
type = "uint32"
access = "const"
default = 5
[[object]]
index = 0x2000
name = "program"
class = "DOMAIN"
[[object]]
index = 0x6000
name = "level"
type = "uint16"
[[pdo]]
dir = "T"
number = 1
map = ["level"]
[[pdo]]
dir = "R"
number = 1
map = ["level"]
"""


def exchanged(codec: Codec, *arguments: Any, **more: Any) -> Message:
    """A message sent and received."""
    return codec.decode_message(codec.encode_message(Message(*arguments, **more)))


@pytest.mark.requirement("R91", "R92", "R97", "R98", "R101", "R102")
def test_one_variable_is_reached_by_sdo_and_by_pdo() -> None:
    codec = Codec(parse_toml(NETWORK))
    value: dict[Key, Value] = {(0x6000, 0): 0x1234}
    read = exchanged(codec, "read", "response", index=0x6000, values=value)
    write = exchanged(codec, "write", "request", index=0x6000, values=value)
    pdos = [exchanged(codec, "pdo", "push", pdo=name, values=value) for name in ("T1", "R1")]
    assert [message.values for message in (read, write, *pdos)] == [value] * 4
    assert {message.data for message in (read, write, *pdos)} == {b"\x34\x12"}
    parameter = exchanged(codec, "read", "response", index=0x1000, values={(0x1000, 0): 5})
    assert (parameter.values, parameter.flags) == ({(0x1000, 0): 5}, {})


@pytest.mark.requirement("R102")
@pytest.mark.parametrize("kind", [0x50, 0x90, 0xD0])
def test_a_pdo_is_never_answered(kind: int) -> None:
    codec = Codec(parse_toml(NETWORK))
    octets = codec.envelope.build(
        {"kind": kind & 0x3F, "abort": kind >> 6 & 1, "response": kind >> 7, "index": 0x1A00}, b"ab"
    )
    error = codec.parse_message(octets).error
    assert error is not None
    assert error.code == "E_KIND"


@pytest.mark.requirement("R75")
def test_a_constant_is_read_and_neither_written_nor_mapped_into_an_rpdo() -> None:
    codec = Codec(parse_toml(NETWORK))
    write = exchanged(codec, "write", "request", index=0x1000, values={(0x1000, 0): 6})
    assert write.flags == {"access": ((0x1000, 0),)}
    constant = NETWORK.replace('name = "level"', 'name = "level"\naccess = "const"')
    with pytest.raises(DictionaryError, match="cannot be written by an RPDO"):
        parse_toml(constant)
    assert parse_toml(constant.partition('[[pdo]]\ndir = "R"')[0]).tpdo[1].map[0].variable.access == "const"


@pytest.mark.requirement("R53", "R65")
@pytest.mark.parametrize("size", [0, 1, 1000, 65535])
def test_a_domain_has_any_length(size: int) -> None:
    codec = Codec(parse_toml(NETWORK))
    program = random.Random(size).randbytes(size)
    message = exchanged(codec, "write", "request", index=0x2000, values={(0x2000, 0): program})
    assert message.values == {(0x2000, 0): program}


@pytest.mark.requirement("R99", "R100")
def test_mapping_entries_are_those_of_the_model() -> None:
    """EPSG DS 301, decodeObjectMapping: index in bits 0-15, sub-index 16-23, offset 32-47, length 48-63."""
    od = parse_toml(STATION)
    entries = [variable.default for variable in od[0x1A00] if variable.sub]
    taken = [
        (entry & 0xFFFF, entry >> 16 & 0xFF, entry >> 32 & 0xFFFF, entry >> 48)
        for entry in entries
        if isinstance(entry, int)
    ]
    assert taken == [(0x6000, 1, 0, 1), (0x6000, 2, 1, 1), (0x6001, 0, 4, 12), (0x6000, 4, 16, 16)]
    # The division is not forced on anybody: the same data as a plain struct, no object, PDO or envelope around it.
    octets = Codec(od).encode_type("pump_t", {"run": True, "fault": False, "speed": -1500})
    assert Codec(od).decode_type("pump_t", octets).values == {"run": True, "fault": False, "speed": -1500}
