"""Captured sessions as stable text, and the differences between two of them (docs/golden.md).

`read_session` reads a capture or a golden and returns the same model for both; `golden_text` writes a session as text;
`diff_sessions` lists the differences. A `Session` has `Link`s (connections) and `Transaction`s; nothing in it depends on
clocks, ports, addresses, reference numbers or the interleaving of connections.
"""

from dissect.testing.golden.comparison import diff_sessions
from dissect.testing.golden.difference import Difference, DiffOptions
from dissect.testing.golden.exchange import Exchange, ItemRecord
from dissect.testing.golden.model import GoldenError, Link, Session, Transaction
from dissect.testing.golden.parsing import parse_golden
from dissect.testing.golden.reading import read_session
from dissect.testing.golden.writing import golden_text

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
