"""Finds the items of a push, which are those of the request that began its job (reference 4.7 and 4.8).

A job is identified by the sequence number of the answer that began it. A connection keeps only its latest jobs, and each job
has no more items than fit one request.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.engine.transactions.results import (
    DOUBTS,
    UNCHANGED,
    Subscription,
    has_items,
)
from dissect.engine.transactions.transaction import ANSWERED, PUSH, Transaction
from dissect.protocols.s7.parameters import UserdataHead
from dissect.protocols.s7.tables import CHANGE_DRIVEN_MODIFY, GROUP_CYCLIC, GROUP_TEST, REPLACE_JOB, SUCCESS

#: Maximum number of jobs that are remembered per connection.
MAX_JOBS: Final = 64


def follow(transaction: Transaction) -> None:
    """Take a finished userdata transaction: remember its subscription, or give a push its items.

    If an item or area was refused, the transaction gets ``has_errors``. If the pair that began a job is only likely, the items
    of its pushes are only likely, too.
    """
    head = transaction.parameters.userdata
    if head is None:
        return
    if not has_items(head):
        if head.group == GROUP_TEST and head.subfunction == REPLACE_JOB:
            _forget(transaction)
        return
    jobs = transaction.connection.subscriptions
    if transaction._outcome == PUSH:
        job = jobs.get(_key(transaction, head, head.sequence))
        if job is not None:
            transaction.subscribed = job
            transaction._flags |= job.doubts
    elif transaction._outcome == ANSWERED and not transaction.refused:
        answer = transaction.response_parameters
        told = answer.userdata if answer is not None else None
        changes: bool = head.group == GROUP_CYCLIC and head.subfunction == CHANGE_DRIVEN_MODIFY
        key = _key(transaction, head, head.sequence if changes or told is None else told.sequence)
        jobs.pop(key, None)
        jobs[key] = Subscription(head, transaction.request_octets, transaction._flags & DOUBTS)
        while len(jobs) > MAX_JOBS:
            for oldest in jobs:
                del jobs[oldest]
                break
    if transaction.response_size:
        for result in transaction.s7_results:
            if result.return_code != -1 and result.return_code != SUCCESS and result.return_code != UNCHANGED:
                transaction.has_errors = True


def _key(transaction: Transaction, head: UserdataHead, job: i64) -> int:
    """Return the key of a job: the asking side, the group (and for a test function its number), the job's number."""
    kind: i64 = head.subfunction if head.group == GROUP_TEST else 0
    return ((transaction.asked_by << 8 | head.group) << 8 | kind) << 8 | job


def _forget(transaction: Transaction) -> None:
    """A test job was replaced, so its items are no longer those of its first request: forget the side's test jobs."""
    jobs = transaction.connection.subscriptions
    for key in list(jobs):
        if key >> 16 == transaction.asked_by << 8 | GROUP_TEST:
            del jobs[key]
