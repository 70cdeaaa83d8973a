"""The public API as a user writes it: the names are there, and a type checker knows them."""

from __future__ import annotations

import inspect
import os
import re
import subprocess
import sys
from pathlib import Path

import dissect
from dissect import scd
from dissect.golden.reading import is_golden, load_golden, read_session
from dissect.golden.writing import golden_text
from dissect.playback.client import load_recorded
from dissect.playback.server import load_recording
from dissect.s7.items import DataItem
from dissect.source.pcapng_writer import PcapngWriter

USER = """
from pathlib import Path

import dissect
from dissect import scd
from dissect.engine.observer import Observer

analysis = dissect.analyze("a.pcap", "b.pcap", slow_ns=5)
reveal_type(analysis.latencies.quantile(0.5))
reveal_type(analysis.as_dict())
for event in dissect.open("a.pcap", pdus=False):
    reveal_type(event)
    if isinstance(event, dissect.Transaction):
        reveal_type(event.latency_ns)
        reveal_type(event.errors)
        for result in event.results():
            reveal_type(result.value)
for event in dissect.open("a.pcap", scd=scd.load("plant.toml"), bind=Path("plant.bind.toml")):
    if isinstance(event, dissect.ScdMessage):
        reveal_type(event.message.values)
        for row in event.values:
            reveal_type(row.name)
            reveal_type(row.physical)
    if isinstance(event, dissect.Transaction):
        reveal_type(event.scd)
dissect.analyze("a.pcap", scd="plant.scd", bind="plant.bind.toml")
od = scd.load("plant.toml")
od["Pump 1"]["run"].encode(True), od["Pump 1.run"].bits, od[0x6000]["run"].bits
reveal_type(od.variable("Pump 1.run").encode(True))


class Mine(Observer):
    def transaction(self, transaction: dissect.Transaction) -> None:
        reveal_type(transaction.connection.client)


run = dissect.Run(["a.pcap"], Mine(), dissect.Options(slow_ns=1))
while run.step():
    pass

with dissect.live("eth0", filter="tcp port 102") as events:
    for event in events:
        if isinstance(event, dissect.Transaction):
            reveal_type(event.items)
reveal_type(dissect.stream(("10.0.0.1", 4000), ("10.0.0.2", 102)).client_sent(b""))
with open("a.pcap", "rb") as file:
    dissect.analyze(file, [(1, 1, b"")])
try:
    dissect.analyze("missing.pcap")
except dissect.Error:
    pass
"""

REVEALED = [
    "int | None",
    "dict[str, object]",
    (
        "Connection | dissect.s7.message.Pdu | dissect.s7plus.message.PlusPdu | dissect.transactions.payloads.ScdMessage"
        " | dissect.transactions.transaction.Transaction | dissect.transactions.operation.Operation"
        " | dissect.findings.reporter.Finding"
    ),
    "int | None",
    "list[dissect.transactions.results.TransactionError]",
    "int | float | str | list[bool | int | float | str | None] | None",
    "dict[tuple[int, int] | str, ",
    '"str"',
    "NetTime",
    "list[dissect.transactions.payloads.ScdMessage]",
    "bytes",
    "dissect.tcp.stream.Endpoint",
    "list[tuple[str, str, str, object, str, str, bytes | None, fallback=dissect.transactions.items.TransactionItem]]",
    "list[dissect.transactions.connection.Connection | dissect.s7.message.Pdu",
]


def test_every_public_name_loads() -> None:
    for name in dissect._PUBLIC:
        value = getattr(dissect, name)
        assert callable(value), name
        assert value.__name__.removeprefix("dissect.") == name  # the room `dissect.live` is called as its function


def test_a_users_program_passes_strict_type_checking(tmp_path: Path) -> None:
    program = tmp_path / "user.py"
    program.write_text(USER, encoding="utf-8")
    command = [sys.executable, "-m", "mypy", "--strict", "--cache-dir", os.devnull, str(program)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stdout
    lines = [line for line in done.stdout.splitlines() if "Revealed type" in line]
    assert len(lines) == len(REVEALED)
    for line, expected in zip(lines, REVEALED, strict=True):
        assert expected in line


# ---- what a person sees of it ---------------------------------------------------------------------------------------


class Elsewhere:
    """A path of another kind than pathlib's."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __fspath__(self) -> str:
        return str(self._path)


CAPTURES = Path(__file__).parents[1] / "captures"


def test_paths_of_any_kind_are_taken(tmp_path: Path) -> None:
    capture = CAPTURES / "item-errors.pcapng"
    plant, bind = CAPTURES / "scd" / "plant.toml", CAPTURES / "scd" / "plant.bind.toml"
    golden = tmp_path / "a.s7.txt"
    golden.write_text(golden_text(read_session(capture)), encoding="utf-8")
    for kind in (str, Path, Elsewhere):
        analysis = dissect.analyze(kind(capture), kind(capture))
        assert [file.name for file in analysis.files] == [str(capture)] * 2
        assert len(list(dissect.open(kind(capture), pdus=False))) > 5
        assert dissect.analyze(kind(plant.with_suffix(".pcapng")), scd=kind(plant), bind=kind(bind)).total > 5
        run = dissect.Run([kind(capture)], dissect.Observer())
        while run.step():
            pass
        assert run.files[0].name == str(capture)
        assert read_session(kind(capture)).name == str(capture)
        assert is_golden(kind(golden))
        assert load_golden(kind(golden)).transactions
        assert load_recording(kind(capture)).name
        assert load_recorded(kind(capture)).links
        assert len(scd.load(kind(plant)))
        out = kind(tmp_path / f"{kind.__name__}.pcapng")
        PcapngWriter(out).close()
        assert Path(out).stat().st_size


def test_representations_say_what_a_thing_is() -> None:
    found = {type(event).__name__: event for event in dissect.open(str(CAPTURES / "item-errors.pcapng"))}
    shown = {name: repr(event) for name, event in found.items()}
    assert re.fullmatch(r"Pdu\(Ack_Data, Write Var, ref \d+, packet \d+\)", shown["Pdu"])
    assert shown["Connection"] == "Connection(1, 127.0.0.1:45840 → 127.0.0.1:102, 16 PDUs)"
    pdu, transaction = found["Pdu"], found["Transaction"]
    connection, finding = found["Connection"], found["Finding"]
    assert isinstance(pdu, dissect.Pdu)
    assert isinstance(transaction, dissect.Transaction)
    assert isinstance(connection, dissect.Connection)
    assert isinstance(finding, dissect.Finding)
    told = [repr(item) for item in (*pdu.data_items(), *transaction.results(), *transaction.errors)]
    told += [repr(connection.client), repr(connection.tsap_called), repr(finding.rule)]
    told.append(repr(dissect.analyze(CAPTURES / "item-errors.pcapng")))
    assert [text for text in (*shown.values(), *told) if " object at 0x" in text] == []
    assert repr(transaction.connection.granted) == "Setup(1, 1, 480)"
    assert repr(DataItem(0xFF, 4, 16, b"\x04\xd2", 0)) == "DataItem(0xff, 2 bytes: 04 d2)"


def test_every_public_name_says_what_it_is_compiled_or_not() -> None:
    for name in dissect._PUBLIC:
        value = getattr(dissect, name)
        assert value.__doc__, name
        if isinstance(value, type):
            written = dissect._written_doc(value.__module__, name)
            assert written
            assert inspect.cleandoc(value.__doc__).split("\n\nAttributes:\n")[0] == written, name
    assert dissect._written_doc("dissect.session", "Nothing") is None
    assert dissect._written_doc("dissect.nothing", "Run") is None
