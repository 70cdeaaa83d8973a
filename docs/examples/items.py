"""Print items of S7comm, S7comm-plus and SCD alike, refused ones included."""

from collections.abc import Iterator
from itertools import islice

import dissect


def items(path: str, scd: str | None = None, bind: str | None = None) -> Iterator[dissect.TransactionItem]:
    """Give the items of all transactions of a capture."""
    for event in dissect.open(path, pdus=False, scd=scd, bind=bind):
        if isinstance(event, dissect.Transaction):
            yield from event.items


for found in (
    items("captures/item-errors.pcapng"),
    items("captures/crafted/plus-plant.pcapng"),
    items("captures/scd/plant.pcapng", "captures/scd/plant.toml", "captures/scd/plant.bind.toml"),
):
    for item in islice(found, 3, 6):
        print(item.name, item.type, item.value, item.unit, item.result)

# Output:
# DB1.DBB0 3 x BYTE [0, 1, 2]  ok
# DB99.DBB0 4 x BYTE None  Object does not exist
# DB2.DBD16 REAL 3.5  ok
# DB1."pump" Bool None  ok
# DB1 LID 99  None  ok
# CPUexecUnit.DIS.OperatingState  None  ok
# Слово состояния 2 uint16 567  ok
# Расход 2 int32 900  ok
# Режим 2 int8 8  ok
