"""What the commands write for programs, from our captures, held to the published schemas.

A validator takes milliseconds for an object, and a capture holds hundreds that differ in numbers only. So of objects with the
same keys, the same types and the same words (what an enumeration may hold) one is held to its schema.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import click
import pytest

from dissect import scd
from dissect.cli.formats import FormatType
from dissect.cli.main import COMMANDS, group
from dissect.meaning.report.formats import formats_for
from dissect.testing.oracle.tshark import version
from dissect.testing.playback.server import Server
from tests.cli.support import Ran, run, simple
from tests.meaning.report.schemas import NAMES, ROOT, SCHEMAS, complaints, load
from tests.meaning.report.support import OWN
from tests.testing.playback.client.support import changed

Capture = pytest.CaptureFixture[bytes]
PLANT: Final = ROOT / "captures" / "scd" / "plant.toml"
BINDING: Final = ("--scd", PLANT, "--bind", ROOT / "captures" / "scd" / "plant.bind.toml")
TAGS: Final = ("--tags", ROOT / "captures" / "tags" / "valve.csv")
TRAFFIC: Final = ROOT / "captures" / "scd" / "plant.pcapng"
#: Every capture that is whole: the damaged ones have exit codes of their own.
WHOLE: Final = [path for path in OWN if not path.name.startswith(("cut-gzip", "cut-pcap"))]
_WORD: Final = re.compile(r"[a-z][a-z0-9_./-]{0,40}")
_held: set[tuple[str, str]] = set()


def shape(value: object) -> object:
    """Return what decides whether a value is as the schema says, but for patterns and the sizes of numbers."""
    if isinstance(value, dict):
        return {key: shape(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return sorted({json.dumps(shape(inner)) for inner in value})
    if isinstance(value, str) and _WORD.fullmatch(value):
        return value
    return type(value).__name__


def held(told: dict[str, Any]) -> None:
    """Hold an object to the schema that it names."""
    name, _, number = told["schema"].removeprefix("s7dissect.").partition("/")
    assert (name in NAMES, number) == (True, "1")
    key = (name, json.dumps(shape(told)))
    if key not in _held:
        assert complaints(name, told, exact=True) == []
        _held.add(key)


def lines_of(ran: Ran, codes: Iterable[int] = (0,)) -> list[dict[str, Any]]:
    """Return the objects of JSON lines, each held to its schema."""
    assert ran.code in codes, ran.err
    assert ran.out.isascii()
    assert "\x7f" not in ran.out
    told: list[dict[str, Any]] = [json.loads(line) for line in ran.out.splitlines()]
    for line in told:
        held(line)
    return told


def object_of(ran: Ran, codes: Iterable[int] = (0,)) -> dict[str, Any]:
    """Return the object that a command wrote, held to its schema."""
    assert ran.code in codes, ran.err
    assert ran.out.isascii()
    told: dict[str, Any] = json.loads(ran.out)
    held(told)
    return told


# ---- the commands over captures -------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", ["transactions", "operations", "show", "monitor"])
def test_lines_of_every_capture(capfdbinary: Capture, command: str) -> None:
    told = [line for path in WHOLE for line in lines_of(run(capfdbinary, command, path, "-T", "jsonl"))]
    assert len(told) > 200
    assert {line["schema"] for line in told} == {
        "transactions": {"s7dissect.transaction/1"},
        "operations": {"s7dissect.operation/1"},
        "show": {"s7dissect.pdu/1"},
        "monitor": {"s7dissect.transaction/1", "s7dissect.operation/1", "s7dissect.event/1"},
    }[command]


@pytest.mark.parametrize("command", ["transactions", "show", "monitor"])
def test_lines_with_scd(capfdbinary: Capture, command: str) -> None:
    told = lines_of(run(capfdbinary, command, TRAFFIC, *BINDING, "-T", "jsonl"))
    assert any("scd" in line for line in told)


def test_lines_of_two_files_name_them(capfdbinary: Capture) -> None:
    pair = (ROOT / "captures" / "transfer.pcapng", ROOT / "captures" / "szl.pcapng")
    for command, key in (("transactions", "request_file"), ("operations", "first_file"), ("show", "file")):
        assert all(key in line for line in lines_of(run(capfdbinary, command, *pair, "-T", "jsonl")))


def test_blocks_of_every_capture(capfdbinary: Capture) -> None:
    told = [object_of(run(capfdbinary, "blocks", path, "-T", "json", *TAGS)) for path in WHOLE]
    found = [block for one in told for block in one["blocks"]]
    assert {block["protocol"] for block in found} == {"s7comm", "s7comm_plus"}
    assert {block["activated"] for block in found} == {True, False, None}
    assert any(block.get("values") for block in found)
    program = ROOT / "captures" / "crafted" / "program.pcapng"
    for path in (program, *[path for path, one in zip(WHOLE, told, strict=True) if one["blocks"]]):
        for how in (("--code", "AWL"), ("--references",)):
            object_of(run(capfdbinary, "blocks", *how, path, "-T", "json", *TAGS))
    assert object_of(run(capfdbinary, "blocks", "--diff", program, "-T", "json"), (1,))["changes"][0]["details"]
    for first, second in pairwise([path for path, one in zip(WHOLE, told, strict=True) if one["blocks"]]):
        object_of(run(capfdbinary, "blocks", "--diff", first, second, "-T", "json"), (0, 1))


def test_devices_of_every_capture(capfdbinary: Capture) -> None:
    told = [object_of(run(capfdbinary, "devices", path, "-T", "json")) for path in WHOLE]
    assert {device["role"] for one in told for device in one["devices"]} >= {"CPU", "engineering", "panel", "unknown"}
    assert sum(len(device["modules"]) for one in told for device in one["devices"]) > 20
    pair = object_of(run(capfdbinary, "devices", *WHOLE[:2], "-T", "json"))
    assert all("first_file" in device for device in pair["devices"])
    part = object_of(run(capfdbinary, "devices", WHOLE[0], "-T", "json", "-Y", "function == read"))
    assert part["selection"]["where"] == "function == read"


def test_diffs_of_captures_with_the_next(capfdbinary: Capture) -> None:
    kinds = set()
    for first, second in pairwise(WHOLE):
        told = object_of(run(capfdbinary, "diff", first, second, "-T", "json", "--max", "20"), (0, 1))
        assert told["count"] == told["not_shown"] + len(told["differences"])
        kinds |= {difference["kind"] for difference in told["differences"]}
    assert {"connections", "tsaps", "negotiation", "endings", "missing", "added", "values", "codes"} <= kinds


@pytest.mark.parametrize(
    ("values", "key", "kinds"),
    [
        ("mask", "masked", {"values", "unknown_octets", "block_contents", "passwords", "s7comm_plus"}),
        ("scramble", "replaced", {"values", "names", "serial_numbers", "ip_addresses", "mac_addresses"}),
        ("keep", "kept", {"values"}),
    ],
)
def test_anonymized_captures(capfdbinary: Capture, tmp_path: Path, values: str, key: str, kinds: set[str]) -> None:
    found = set()
    for path in WHOLE:
        ran = run(
            capfdbinary, "anonymize", path, "-o", tmp_path / path.stem, "--values", values, "-T", "json", "--force"
        )
        if ran.code == 2:
            assert (ran.out, "the capture contains no S7 packets" in ran.err) == ("", True)
            continue
        account = object_of(ran)
        assert account["packets"] == account["written"] + sum(account["dropped"].values())
        found |= set(account[key])
    assert kinds <= found


def test_alerts_of_captures(capfdbinary: Capture, tmp_path: Path) -> None:
    plant = tmp_path / "plant.toml"
    learned = run(capfdbinary, "baseline", ROOT / "captures" / "read-areas.pcapng", "-o", plant)
    assert learned.code == 0, learned.err
    told = [
        alert
        for path in WHOLE
        for alert in lines_of(run(capfdbinary, "baseline", path, "--against", plant, "-T", "jsonl"), (0, 1))
    ]
    assert {alert["new"]["kind"] for alert in told if "new" in alert} >= {"client", "tsap", "function", "read", "write"}


def test_a_replay(capfdbinary: Capture, tmp_path: Path) -> None:
    path = simple(tmp_path / "a.pcapng")
    with Server(changed(path, 0, 1, b"\x04\xd2", b"\x04\xd3")) as server:
        to = ("--to", f"127.0.0.1:{server.port}")
        told = object_of(run(capfdbinary, "replay", path, *to, "-T", "json"), (1,))
        part = ROOT / "captures" / "plc-control.pcapng"
        held_back = object_of(run(capfdbinary, "replay", part, *to, "-T", "json", "--timeout", "1"), (0, 1))
    gone = object_of(run(capfdbinary, "replay", path, "--to", "127.0.0.1:9", "-T", "json"), (2,))
    assert told["differences"][0]["kind"] == "values"
    assert held_back["replay"]["withheld"]
    assert gone["replay"]["unreachable"] == 1


def test_a_verification(capfdbinary: Capture) -> None:
    version()
    told = object_of(
        run(capfdbinary, "verify", ROOT / "captures" / "crafted" / "references.pcapng", "-T", "json"), (0, 1)
    )
    assert told["files"][0]["pdus"] > 0


def test_interfaces(capfdbinary: Capture) -> None:
    assert object_of(run(capfdbinary, "interfaces", "-T", "json"))["engines"]


# ---- SCD ------------------------------------------------------------------------------------------------------------


def test_checked_dictionaries(capfdbinary: Capture, tmp_path: Path) -> None:
    cut = tmp_path / "cut.scd"
    cut.write_bytes(scd.compile(PLANT).octets[:-1])
    broken = tmp_path / "broken.toml"
    broken.write_text('[dictionary]\nname = "a"\n[[object]]\nindex = 1\nname = "b"\ntype = "uint8"\n', encoding="utf-8")
    told = lines_of(run(capfdbinary, "scd", "check", PLANT, cut, broken, "-T", "json"), (1,))
    assert [line["error"] is None for line in told] == [True, False, False]


@pytest.mark.parametrize(
    ("old", "new", "level"), [("", "", "same"), ('"Журнал"', '"Log"', "names"), ("bits = 12", "bits = 13", "wire")]
)
def test_compared_dictionaries(capfdbinary: Capture, tmp_path: Path, old: str, new: str, level: str) -> None:
    other = tmp_path / "other.toml"
    other.write_text(PLANT.read_text("utf-8").replace(old, new), "utf-8")
    assert object_of(run(capfdbinary, "scd", "diff", PLANT, other, "-T", "json"), (0, 1, 2))["level"] == level


@pytest.mark.parametrize(
    ("arguments", "codes"),
    [
        (["--pdo", "T2", "C1AB24FA"], (0,)),
        (["--pdo", "T2", "C1AB24FA00"], (0,)),
        (["--type", "pump_t", "01000100"], (0, 2)),
        (["--value", "0x6001", "FF0F"], (0,)),
        (["--message", "DC0207004160 00000000 D5D2"], (0,)),
        (["--message", "DC0207004160 00000000 D5D3"], (3,)),
    ],
)
def test_decoded_octets(capfdbinary: Capture, arguments: list[str], codes: tuple[int, ...]) -> None:
    ran = run(capfdbinary, "scd", "decode", "-d", PLANT, *arguments, "-T", "json")
    assert len(lines_of(ran, codes)) == (0 if ran.code == 2 else 1)


# ---- nothing without a schema ---------------------------------------------------------------------------------------


def formats(command: click.Command) -> set[str]:
    """Return what a command may be asked to write."""
    kinds = [each.type.kind for each in command.params if isinstance(each.type, FormatType)]
    return {one.name for kind in kinds for one in formats_for(kind)}


def commands() -> dict[str, click.Command]:
    """Return every command by what is written to call it."""
    context = click.Context(group)
    found = {}
    for name in COMMANDS:
        command = group.get_command(context, name)
        assert command is not None
        if isinstance(command, click.Group):
            inner = click.Context(command)
            for each in command.list_commands(inner):
                told = command.get_command(inner, each)
                assert told is not None
                found[f"{name} {each}"] = told
        else:
            found[name] = command
    return found


def test_formats_are_called_the_same_everywhere() -> None:
    asked = {name: formats(command) for name, command in commands().items()}
    assert set().union(*asked.values()) == {"text", "json", "jsonl", "csv", "junit", "html", "fields"}
    for name, names in asked.items():
        assert "text" in names or not names, name
        assert not {"json", "jsonl"} <= names, name
    for command in commands().values():
        for option in command.params:
            if option.name == "format_":
                assert option.opts == ["-T", "--format"]


def test_every_output_has_a_row_and_a_schema() -> None:
    text = (ROOT / "docs" / "json.md").read_text(encoding="utf-8")
    table = text.split("The schemas are part", 1)[0]
    for name, command in commands().items():
        for format_ in formats(command) - {"text", "fields"}:
            row = re.search(rf"`(s7dissect )?{name}\b[^`]*( -T {format_}\b[^`]*`|`[^|]*`-T {format_}`)", table)
            assert row is not None, f"{name} -T {format_}"
    assert sorted(re.findall(r"`s7dissect\.([a-z-]+)/1`", table)) == sorted(NAMES)


def test_every_name_in_the_code_is_a_schema() -> None:
    written = {
        name
        for path in (ROOT / "dissect").rglob("*.py")
        for name in re.findall(r'"s7dissect\.([a-z-]+)/[0-9]+"', path.read_text(encoding="utf-8"))
    }
    files = {path.name.removesuffix(".schema.json") for path in SCHEMAS.iterdir()}
    assert written == files == set(NAMES)
    for name in NAMES:
        assert load(name)["$id"] == f"urn:s7dissect:schema:{name}:1"
        assert load(name)["properties"]["schema"]["const"] == f"s7dissect.{name}/1"
