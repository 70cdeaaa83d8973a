"""What a request does to a PLC: reads, writes, or controls. Nobody's guess: what is not in the lists below counts as control.

After docs of the functions in `dissect.s7.tables` and the events that `dissect.findings.security_rules` tells.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from dissect.playback.client.download import DOWNLOADING_JOBS
from dissect.s7.message import parse_pdu
from dissect.s7.parameters import HEADER_SIZE, PROTOCOL_ID, REQUEST
from dissect.s7.tables import (
    END_UPLOAD,
    JOB,
    READ_VAR,
    SETUP_COMMUNICATION,
    START_UPLOAD,
    UPLOAD,
    USERDATA,
    WRITE_VAR,
)

READ: Final = "read"
WRITE: Final = "write"
CONTROL: Final = "control"

#: Jobs that change nothing in the PLC.
READING_JOBS: Final = frozenset((SETUP_COMMUNICATION, READ_VAR, START_UPLOAD, UPLOAD, END_UPLOAD))
#: Function group and subfunction of userdata requests that change nothing in the PLC, but for what it sends to this client.
READING_USERDATA: Final = frozenset((
    (0x02, 0x01),  # cyclic transfer
    (0x02, 0x04),  # unsubscribe
    (0x02, 0x05),  # change driven transfer
    (0x02, 0x08),  # RDREC
    (0x03, 0x01),  # list blocks
    (0x03, 0x02),  # list blocks of type
    (0x03, 0x03),  # get block info
    (0x04, 0x01),  # read SZL
    (0x04, 0x02),  # message service
    (0x04, 0x13),  # ALARM query
    (0x07, 0x01),  # read clock
    (0x07, 0x03),  # read clock (following)
))  # fmt: skip

#: Why a request is not sent.
NO_WRITE: Final = "writes are only sent with --allow-write"
NO_CONTROL: Final = "control requests are only sent with --allow-control"
_NC_DOWNLOAD: Final = (0x3F, 0x01)
DOWNLOAD: Final = "the NC would request the file, and requests of an NC are never answered"


def kind_of(octets: bytes) -> str:
    """Return what a PDU does: `READ`, `WRITE`, or `CONTROL`, which everything is that is not surely one of the others.

    A PDU with anything missing, malformed or behind its end is control.
    """
    if len(octets) < HEADER_SIZE or octets[0] != PROTOCOL_ID:
        return CONTROL
    pdu = parse_pdu(octets)
    if pdu.malformed or pdu.data_offset + pdu.data_length != len(octets):
        return CONTROL
    if pdu.rosctr == JOB:
        if pdu.function == WRITE_VAR:
            return WRITE
        return READ if pdu.function in READING_JOBS else CONTROL
    head = pdu.parameters.userdata
    if pdu.rosctr == USERDATA and head is not None and head.type == REQUEST:
        return READ if (head.group, head.subfunction) in READING_USERDATA else CONTROL
    return CONTROL


class Permissions(NamedTuple):
    """What may be sent beside reads."""

    write: bool = False
    control: bool = False

    def refusal(self, octets: bytes) -> str:
        """Return why a PDU must not be sent, empty when it may. Whatever is sent has passed here, octet for octet."""
        kind = kind_of(octets)
        if kind == WRITE and not self.write:
            return NO_WRITE
        if kind == CONTROL and _begins_nc_download(octets):
            return DOWNLOAD
        return NO_CONTROL if kind == CONTROL and not self.control else ""

    def answers(self, octets: bytes) -> bool:
        """Tell whether what a server asks may be answered: the jobs of a download, where control is allowed."""
        if not self.control or len(octets) < HEADER_SIZE or octets[0] != PROTOCOL_ID:
            return False
        pdu = parse_pdu(octets)
        whole = not pdu.malformed and pdu.data_offset + pdu.data_length == len(octets)
        return whole and pdu.rosctr == JOB and pdu.function in DOWNLOADING_JOBS


def _begins_nc_download(octets: bytes) -> bool:
    """Tell whether an NC goes on with requests of its own."""
    head = parse_pdu(octets).parameters.userdata
    return head is not None and (head.group, head.subfunction) == _NC_DOWNLOAD
