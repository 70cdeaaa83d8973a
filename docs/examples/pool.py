"""Use all cores: one process for each capture."""

from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import dissect

if __name__ == "__main__":
    files = sorted(Path("captures").glob("answer-*.pcapng"))
    with ProcessPoolExecutor() as pool:
        for path, analysis in zip(files, pool.map(dissect.analyze, files), strict=True):
            print(path.name, analysis.total, "transactions,", analysis.unanswered, "unanswered")

# Output:
# answer-after-fin.pcapng 4 transactions, 0 unanswered
# answer-lost.pcapng 7 transactions, 1 unanswered
# answer-slow.pcapng 7 transactions, 0 unanswered
# answer-twice.pcapng 8 transactions, 0 unanswered
