"""Read captures from wherever they are: files, open files, memory, several at once."""

import gzip
import io
from pathlib import Path

import dissect

path = Path("captures/item-errors.pcapng")
print(dissect.analyze(path))
with path.open("rb") as file:
    print(dissect.analyze(file))
print(dissect.analyze(io.BytesIO(gzip.compress(path.read_bytes()))))
print(dissect.analyze(path, "captures/answer-lost.pcapng"))

# Output:
# Analysis(1 connections, 8 transactions, 7 with errors, 0 unanswered)
# Analysis(1 connections, 8 transactions, 7 with errors, 0 unanswered)
# Analysis(1 connections, 8 transactions, 7 with errors, 0 unanswered)
# Analysis(2 connections, 15 transactions, 7 with errors, 1 unanswered)
