"""Read two captures in two threads of one process."""

from concurrent.futures import ThreadPoolExecutor

import dissect

with ThreadPoolExecutor() as pool:
    for analysis in pool.map(dissect.analyze, ["captures/answer-lost.pcapng", "captures/item-errors.pcapng"]):
        print(analysis)

# Output:
# Analysis(1 connections, 7 transactions, 0 with errors, 1 unanswered)
# Analysis(1 connections, 8 transactions, 7 with errors, 0 unanswered)
