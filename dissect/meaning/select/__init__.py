"""Selection: expressions over the fields of results, in one language for all commands (docs/select.md).

    where = Where("host == 192.168.0.0/24 and latency > 20ms") where.transaction(transaction)

`fields` is the table of fields, `grammar` reads an expression, `literals` knows types of values, `where` makes predicates.
"""

from dissect.meaning.select.errors import SelectError
from dissect.meaning.select.where import Where

__all__ = ["SelectError", "Where"]
