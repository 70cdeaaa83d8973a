"""The table of facts that two faces or more share: a row for a fact, a cell for each face that has it.

To add a fact, add a row; to add a face, add it to `tests.faces.records.FACES` and give its cells in the rows of its facts.
"""

from __future__ import annotations

from typing import Final

from tests.faces import act_facts, connection_facts, field_facts, record_facts, transaction_facts
from tests.faces.cells import Fact

FACTS: Final[list[Fact]] = [
    *connection_facts.ROWS,
    *transaction_facts.ROWS,
    *field_facts.ROWS,
    *record_facts.ROWS,
    *act_facts.ROWS,
]
