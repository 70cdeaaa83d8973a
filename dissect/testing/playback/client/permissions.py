"""The effect of a request on a PLC: read, write, or control, by the effects in `dissect.protocols.s7.tables`.

A request without an effect in the tables counts as control.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from dissect.protocols.s7.message import parse_pdu
from dissect.protocols.s7.parameters import HEADER_SIZE, PROTOCOL_ID, REQUEST
from dissect.protocols.s7.tables import (
    CONTROL,
    FUNCTIONS,
    GROUP_NC,
    JOB,
    NC_REQUEST_DOWNLOAD,
    PROGRAM_READ,
    READ,
    SESSION,
    USERDATA,
    USERDATA_SUBFUNCTIONS,
    WRITE,
)
from dissect.testing.playback.client.download import DOWNLOADING_JOBS
from dissect.testing.playback.client.partner import may_be_answered

#: Kinds that may be sent without permission. Everything else but writes is control, including unknown requests.
HARMLESS: Final = frozenset((READ, SESSION, PROGRAM_READ))

#: Why a request is not sent.
NO_WRITE: Final = "writes are only sent with --allow-write"
NO_CONTROL: Final = "control requests are only sent with --allow-control"
NO_ANSWER: Final = "BSENDs of a PLC are only answered with --allow-control"
DOWNLOAD: Final = "the NC would request the file, and requests of an NC are never answered"


def kind_of(octets: bytes) -> str:
    """Return the effect of a PDU: `READ`, `WRITE`, or `CONTROL` for everything that is not certainly one of the others.

    An incomplete or malformed PDU, or one with extra data, is control.
    """
    if len(octets) < HEADER_SIZE or octets[0] != PROTOCOL_ID:
        return CONTROL
    pdu = parse_pdu(octets)
    if pdu.malformed or pdu.data_offset + pdu.data_length != len(octets):
        return CONTROL
    if pdu.rosctr == JOB:
        return _kind(FUNCTIONS.effect(pdu.function))
    head = pdu.parameters.userdata
    if pdu.rosctr == USERDATA and head is not None and head.type == REQUEST and head.group in USERDATA_SUBFUNCTIONS:
        # An NC sends its own requests even if a file is only read.
        effect = USERDATA_SUBFUNCTIONS[head.group].effect(head.subfunction)
        return _kind(effect) if head.group != GROUP_NC else CONTROL
    return CONTROL


def _kind(effect: str) -> str:
    if effect in HARMLESS:
        return READ
    return WRITE if effect == WRITE else CONTROL


class Permissions(NamedTuple):
    """What may be sent besides reads."""

    write: bool = False
    control: bool = False

    def refusal(self, octets: bytes) -> str:
        """Return why a PDU must not be sent, empty if it may. Every sent PDU is checked here in its final form."""
        kind = kind_of(octets)
        if kind == CONTROL and _begins_nc_download(octets):
            return DOWNLOAD
        return self.refusal_of(kind)

    def refusal_of(self, kind: str) -> str:
        """Return why PDUs of this kind must not be sent, empty if they may."""
        if kind == WRITE and not self.write:
            return NO_WRITE
        return NO_CONTROL if kind == CONTROL and not self.control else ""

    def answers(self, octets: bytes) -> bool:
        """Return whether requests of a server may be answered (jobs of a download and BSENDs): only if control is allowed."""
        if not self.control or len(octets) < HEADER_SIZE or octets[0] != PROTOCOL_ID:
            return False
        pdu = parse_pdu(octets)
        whole = not pdu.malformed and pdu.data_offset + pdu.data_length == len(octets)
        return (whole and pdu.rosctr == JOB and pdu.function in DOWNLOADING_JOBS) or may_be_answered(octets)


def _begins_nc_download(octets: bytes) -> bool:
    """Return whether an NC will send requests of its own."""
    head = parse_pdu(octets).parameters.userdata
    return head is not None and (head.group, head.subfunction) == (GROUP_NC, NC_REQUEST_DOWNLOAD)
