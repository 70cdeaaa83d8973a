"""A function with types: mypy in strict mode and pyright know what every attribute is."""

from collections.abc import Iterator
from pathlib import Path

import dissect


def refusals(path: Path) -> Iterator[tuple[int, str, str]]:
    """Give packet, address and reason of each refused item."""
    for event in dissect.open(path, pdus=False):
        if isinstance(event, dissect.Transaction):
            for item in event.items:
                if not item.ok:
                    yield event.response_frame, item.address, item.result


for frame, address, reason in refusals(Path("captures/item-errors.pcapng")):
    print(frame, address, reason)

# Output:
# 11 DB99.DBB0 Object does not exist
# 13 DB2.DBB98 Invalid address
# 15 MB120 Invalid address
# 17 DB99.DBB0 Object does not exist
# 17 DB2.DBW99 Invalid address
# 17 IB500 Invalid address
# 19 DB99.DBB0 Object does not exist
# 21 DB2.DBB99 Invalid address
# …
