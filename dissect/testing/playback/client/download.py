"""Downloads: the PLC requests a block piece by piece, and the client answers from the recording (reference 3.7).

A recorded download is played completely or not at all. It is complete if the recording has the client's answer to every job of
the PLC up to the last one, if the PLC refused it, or if the client sent the pieces without being asked.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Final

from dissect.protocols.s7.message import parse_pdu
from dissect.protocols.s7.tables import ACK_DATA, DOWNLOAD_BLOCK, DOWNLOAD_ENDED, JOB, REQUEST_DOWNLOAD
from dissect.testing.golden.exchange import S7
from dissect.testing.golden.masking import mask_s7
from dissect.testing.golden.model import Transaction

#: Jobs of a PLC that belong to a download.
DOWNLOADING_JOBS: Final = frozenset((DOWNLOAD_BLOCK, DOWNLOAD_ENDED))
#: Position of the length of the block's name in the parameters of all three jobs; the name follows.
_NAME_AT: Final = 8


class Download:
    """A recorded download: its Request download, and the jobs of the PLC that belong to it, in order.

    ``pushed``: the client sent the pieces without being asked, as some libraries do.
    """

    def __init__(self, request: Transaction) -> None:
        self.request = request
        self.jobs: list[Transaction] = []
        self.pushed = False

    @property
    def whole(self) -> bool:
        """True if it can be played to its end."""
        if self.request.error_code or self.pushed:
            return True
        answered = all([job.request and job.response for job in self.jobs])
        return answered and bool(self.jobs) and self.jobs[-1].function == DOWNLOAD_ENDED

    def refusal(self, pdu_length: int) -> str:
        """Return why it must not begin with a negotiated ``pdu_length`` (0 if unknown), empty if it may."""
        longest = max([len(job.response) for job in self.jobs], default=0)
        if pdu_length and longest > pdu_length:
            return f"a piece of {longest} bytes does not fit the PDU length of {pdu_length} that was granted"
        return ""


def find_downloads(transactions: Sequence[Transaction]) -> list[Download]:
    """Return the downloads of a connection, each with the jobs that name its block before it ends."""
    downloads: list[Download] = []
    going: dict[bytes, Download] = {}
    for transaction in transactions:
        request = transaction.exchange.request_pdu if transaction.exchange.kind == S7 else None
        if request is None or request.rosctr != JOB:
            continue
        by_client = transaction.asked_by == "client"
        block = _block(request.parameters.octets)
        if transaction.function == REQUEST_DOWNLOAD and by_client:
            going[block] = Download(transaction)
            downloads.append(going[block])
        elif transaction.function in DOWNLOADING_JOBS and block in going:
            if by_client:
                going[block].pushed = True
            else:
                going[block].jobs.append(transaction)
            if transaction.function == DOWNLOAD_ENDED:
                del going[block]
    return downloads


def _block(parameters: bytes) -> bytes:
    size = parameters[_NAME_AT] if len(parameters) > _NAME_AT else 0
    return parameters[_NAME_AT + 1 : _NAME_AT + 1 + size]


class Downloads:
    """The jobs that a server may send now: those of accepted downloads, each once, equal ones in recorded order."""

    def __init__(self, recorded: Sequence[Download]) -> None:
        self._recorded = {id(download.request): download for download in recorded}
        self._open: dict[bytes, Download] = {}  # by block: the download that began last
        # For each download: the remaining jobs, equal ones together.
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
        response = parse_pdu(answer)
        if (
            response.rosctr != ACK_DATA
            or response.function != REQUEST_DOWNLOAD
            or response.error_class
            or response.error_code
        ):
            return
        self._open[block] = download
        jobs = self._left[block] = {}
        for job in download.jobs:
            jobs.setdefault(job.request, deque()).append(job)

    def next(self, job: bytes) -> Transaction | None:
        """Return and remove the recorded job equal to a job of the server except for its reference; None if there is none."""
        left = self._left.get(_block(parse_pdu(job).parameters.octets), {})
        jobs = left.get(mask_s7(job))
        if not jobs:
            return None
        recorded = jobs.popleft()
        self._asked.add(id(recorded))
        return recorded

    def was_asked(self, job: Transaction) -> bool:
        """Return whether the server has sent all jobs that it sent in the recording."""
        return id(job) in self._asked

    def goes_on(self, download: Download) -> bool:
        """Return whether the server has accepted a download."""
        return any([one is download for one in self._open.values()])
