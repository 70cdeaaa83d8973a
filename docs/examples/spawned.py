"""Send events to another process: transactions, findings and the rest can be pickled."""

import multiprocessing
from concurrent.futures import ProcessPoolExecutor

import dissect


def judge(transaction: dissect.Transaction) -> str:
    """Do the slow part of the work, elsewhere."""
    return f"{transaction}: {len(transaction.errors)} errors"


if __name__ == "__main__":
    events = dissect.open("captures/item-errors.pcapng", pdus=False)
    transactions = [event for event in events if isinstance(event, dissect.Transaction)]
    with ProcessPoolExecutor(2, multiprocessing.get_context("spawn")) as pool:
        for line in pool.map(judge, transactions[:3]):
            print(line)

# Output:
# Setup communication: answered: 0 errors
# Read Var DB99.DBB0 x4: answered, Object does not exist: 1 errors
# Read Var DB2.DBB98 x10: answered, Invalid address: 1 errors
