"""The public API as a user writes it: the names are there, and a type checker knows them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import dissect

USER = """
from pathlib import Path

import dissect
from dissect import scd
from dissect.engine.conversation import Observer

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


class Mine(Observer):
    def transaction(self, transaction: dissect.Transaction) -> None:
        reveal_type(transaction.connection.client)


run = dissect.Run(["a.pcap"], Mine(), dissect.Options(slow_ns=1))
while run.step():
    pass
"""

REVEALED = [
    "int | None",
    "dict[str, object]",
    (
        "Connection | dissect.s7.message.Pdu | dissect.s7plus.message.PlusPdu | dissect.transactions.payloads.ScdMessage"
        " | dissect.transactions.transaction.Transaction | dissect.transactions.operation.Operation"
        " | dissect.findings.finding.Finding"
    ),
    "int | None",
    "list[dissect.transactions.transaction.TransactionError]",
    "int | float | str | list[bool | int | float | str | None] | None",
    "dict[tuple[int, int] | str, ",
    '"str"',
    "NetTime",
    "list[dissect.transactions.payloads.ScdMessage]",
    "dissect.tcp.connection.Endpoint",
]


def test_every_public_name_loads() -> None:
    for name in dissect._PUBLIC:
        assert getattr(dissect, name).__name__ == name


def test_a_users_program_passes_strict_type_checking(tmp_path: Path) -> None:
    program = tmp_path / "user.py"
    program.write_text(USER, encoding="utf-8")
    command = [sys.executable, "-m", "mypy", "--strict", "--cache-dir", str(tmp_path / "cache"), str(program)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stdout
    lines = [line for line in done.stdout.splitlines() if "Revealed type" in line]
    assert len(lines) == len(REVEALED)
    for line, expected in zip(lines, REVEALED, strict=True):
        assert expected in line
