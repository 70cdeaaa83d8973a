"""Captured sessions as stable text, and what changed between two of them (docs/golden.md).

`read_session` takes a capture or a golden and gives the same model of either; `golden_text` writes one as text;
`diff_sessions` tells what changed. A `Session` has `Link`s (connections) and `Transaction`s; nothing of it depends on clocks,
ports, addresses, reference numbers or on how connections were interleaved.
"""

from dissect.golden.comparison import diff_sessions
from dissect.golden.difference import Difference, DiffOptions
from dissect.golden.exchange import Exchange, ItemRecord
from dissect.golden.model import GoldenError, Link, Session, Transaction
from dissect.golden.parsing import parse_golden
from dissect.golden.reading import read_session
from dissect.golden.writing import golden_text

__all__ = [
    "DiffOptions",
    "Difference",
    "Exchange",
    "GoldenError",
    "ItemRecord",
    "Link",
    "Session",
    "Transaction",
    "diff_sessions",
    "golden_text",
    "parse_golden",
    "read_session",
]
