"""Shared by these tests: a capture made anonymous in this process, and the summary of that."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import dissect
from dissect.engine.pipeline import Options
from dissect.engine.transactions.transaction import Transaction
from dissect.files.anonymize.account import Account, Choices
from dissect.files.anonymize.addresses import AddressMap
from dissect.files.anonymize.key import Key
from dissect.files.anonymize.packet import Packets
from dissect.files.anonymize.plus import PlusRules
from dissect.files.anonymize.plus_contents import PlusContents
from dissect.files.anonymize.rewriter import Rewriter
from dissect.files.anonymize.rules import Rules
from dissect.files.anonymize.scd import ScdRules
from dissect.files.anonymize.survey import Survey
from dissect.files.session import Run
from dissect.meaning.bindings.engine import ScdCarrier
from dissect.packets.source.files import open_capture
from dissect.packets.source.pcapng_writer import PcapngWriter
from dissect.protocols.s7plus.assembly import MAX_PDU

#: Captures of which contents become zeros: encrypted ones, and bodies that leave the format (captures/README.md).
BLANKED: Final = frozenset(("s7commplus-tls.pcapng", "s7commplus.pcapng"))
KEY: Final = Key(b"a key of these tests")


def anonymized(
    source: Path,
    out: Path,
    choices: Choices | None = None,
    key: Key = KEY,
    carrier: ScdCarrier | None = None,
    largest: int = MAX_PDU,
) -> Account:
    """Anonymize ``source`` to ``out``, and return its account. A bug of ours raises."""
    choices = choices if choices is not None else Choices()
    account = Account()
    addresses = AddressMap(key)
    rules = Rules(key, addresses, choices, ScdRules(key, addresses, choices, carrier, account))
    plus = PlusRules(PlusContents(key, choices, account), account)
    survey = Survey(key, rules, plus, account, carrier, largest)
    run = Run([str(source)], survey, Options(strict=True, decoder=carrier))
    while run.step():
        pass
    survey.settle()
    writer = PcapngWriter(str(out), overwrite=True)
    shift_ns = key.shift_ns if choices.shift_time else 0
    rewriter = Rewriter(Packets(survey, addresses, choices, account), writer, account, shift_ns)
    reader = open_capture(str(source))
    while reader.step(rewriter):
        pass
    reader.close()
    rewriter.finish()
    writer.close()
    return account


def told(path: Path) -> list[tuple[object, ...]]:
    """Return the facts of each transaction of a capture that must be the same before and after."""
    return [
        (
            int(event.connection.number),
            int(event.function),
            event.function_name,
            int(event.pdu_ref),
            event.outcome,
            event.reason,
            event.latency_ns,
            [(result.item.label if result.item else "", int(result.return_code)) for result in event.s7_results],
            [(error.where, error.code, error.address) for error in event.errors],
        )
        for event in dissect.open(str(path))
        if isinstance(event, Transaction)
    ]
