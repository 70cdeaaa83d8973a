"""Downloads: the PLC asks for a block piece by piece, and the client answers with what was recorded (reference 3.7).

A recorded download is played whole or not at all. One is whole when the recording has the client's answer to every job of the
PLC, up to the one that ends it; when the PLC refused it; or when the client sent the pieces by itself.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Final

from dissect.golden.exchange import S7
from dissect.golden.masking import mask_s7
from dissect.golden.model import Transaction
from dissect.s7.message import parse_pdu
from dissect.s7.tables import ACK_DATA, DOWNLOAD_BLOCK, DOWNLOAD_ENDED, JOB, REQUEST_DOWNLOAD

#: Jobs of a PLC that belong to a download.
DOWNLOADING_JOBS: Final = frozenset((DOWNLOAD_BLOCK, DOWNLOAD_ENDED))
#: Where the length of the block's name stands in the parameters of all three jobs; the name follows.
_NAME_AT: Final = 8


class Download:
    """A recorded download: its Request download, and the jobs of the PLC that belong to it, as they were asked.

    ``pushed`` tells that the client sent the pieces without being asked, as some libraries do.
    """

    def __init__(self, request: Transaction) -> None:
        self.request = request
        self.jobs: list[Transaction] = []
        self.pushed = False

    @property
    def whole(self) -> bool:
        """True when it can be played to its end."""
        if self.request.error_code or self.pushed:
            return True
        answered = all([job.request and job.response for job in self.jobs])
        return answered and bool(self.jobs) and self.jobs[-1].function == DOWNLOAD_ENDED

    def refusal(self, pdu_length: int) -> str:
        """Return why it must not begin where ``pdu_length`` was granted (0 for not known), empty when it may."""
        longest = max([len(job.response) for job in self.jobs], default=0)
        if pdu_length and longest > pdu_length:
            return f"a piece of {longest} bytes does not fit the PDU length of {pdu_length} that was granted"
        return ""


def find_downloads(transactions: Sequence[Transaction]) -> list[Download]:
    """Return the downloads of a connection, each with the jobs that name its block and come before it is ended."""
    found: list[Download] = []
    going: dict[bytes, Download] = {}
    for transaction in transactions:
        asked = transaction.exchange.request_pdu if transaction.exchange.kind == S7 else None
        if asked is None or asked.rosctr != JOB:
            continue
        by_client = transaction.asked_by == "client"
        block = _block(asked.parameters.octets)
        if transaction.function == REQUEST_DOWNLOAD and by_client:
            going[block] = Download(transaction)
            found.append(going[block])
        elif transaction.function in DOWNLOADING_JOBS and block in going:
            if by_client:
                going[block].pushed = True
            else:
                going[block].jobs.append(transaction)
            if transaction.function == DOWNLOAD_ENDED:
                del going[block]
    return found


def _block(parameters: bytes) -> bytes:
    size = parameters[_NAME_AT] if len(parameters) > _NAME_AT else 0
    return parameters[_NAME_AT + 1 : _NAME_AT + 1 + size]


class Downloads:
    """What a server may ask for now: the jobs of the downloads it has accepted, each once, equal ones in recorded order."""

    def __init__(self, recorded: Sequence[Download]) -> None:
        self._recorded = {id(download.request): download for download in recorded}
        self._open: dict[bytes, Download] = {}  # by block: what began last
        # Of each: the jobs that were not asked yet, equal ones together.
        self._left: dict[bytes, dict[bytes, deque[Transaction]]] = {}
        self._asked: set[int] = set()

    def answered(self, transaction: Transaction, answer: bytes) -> None:
        """Take the answer to a request: a download begins when the server accepts it."""
        download = self._recorded.get(id(transaction))
        if download is None:
            return
        block = _block(parse_pdu(transaction.request).parameters.octets)
        self._open.pop(block, None)
        self._left.pop(block, None)
        told = parse_pdu(answer)
        if told.rosctr != ACK_DATA or told.function != REQUEST_DOWNLOAD or told.error_class or told.error_code:
            return
        self._open[block] = download
        jobs = self._left[block] = {}
        for job in download.jobs:
            jobs.setdefault(job.request, deque()).append(job)

    def next(self, job: bytes) -> Transaction | None:
        """Return the recorded job that one of the server is, reference apart, and use it up; None when nothing is like it."""
        left = self._left.get(_block(parse_pdu(job).parameters.octets), {})
        jobs = left.get(mask_s7(job))
        if not jobs:
            return None
        found = jobs.popleft()
        self._asked.add(id(found))
        return found

    def was_asked(self, job: Transaction) -> bool:
        """Tell whether the server has asked what it asked when this was recorded."""
        return id(job) in self._asked

    def goes_on(self, download: Download) -> bool:
        """Tell whether the server has accepted a download."""
        return any([one is download for one in self._open.values()])
