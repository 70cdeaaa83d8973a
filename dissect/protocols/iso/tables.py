"""The code tables of COTP: TPDU types, parameters, disconnect reasons, reject causes (X.224, reference section 2)."""

from __future__ import annotations

from typing import Final

from dissect.wire.codes import CodeTable

ED: Final = 0x1
EA: Final = 0x2
UD: Final = 0x4
RJ: Final = 0x5
AK: Final = 0x6
ER: Final = 0x7
DR: Final = 0x8
DC: Final = 0xC
CC: Final = 0xD
CR: Final = 0xE
DT: Final = 0xF

TPDU_TYPES: Final = CodeTable(
    "COTP TPDU type",
    1,
    [
        (0x1, "ED", "Expedited data."),
        (0x2, "EA", "Expedited data acknowledgement."),
        (0x4, "UD", "Unit data (connectionless CLTP)."),
        (0x5, "RJ", "Reject."),
        (0x6, "AK", "Data acknowledgement."),
        (0x7, "ER", "TPDU error."),
        (0x8, "DR", "Disconnect request."),
        (0xc, "DC", "Disconnect confirm."),
        (0xd, "CC", "Connect confirm."),
        (0xe, "CR", "Connect request."),
        (0xf, "DT", "Data."),
    ],
)

PARAMETERS: Final = CodeTable(
    "COTP parameter",
    2,
    [
        (0x08, "ATN extended checksum, 32 bit", "Checksum."),
        (0x09, "ATN extended checksum, 16 bit", "Checksum."),
        (0x85, "acknowledge time", "Milliseconds (class 4)."),
        (0x86, "residual error rate", "Target power of 10, minimum power of 10, TSDU size as power of 2."),
        (0x87, "priority", "0 is the highest."),
        (0x88, "transit delay", "4 x 16 bit ms: target and maximum, calling-called, then called-calling."),
        (0x89, "throughput", "4 x 24 bit bytes/s maximum: target and minimum for each direction; optionally the same 4 for average."),
        (0x8a, "subsequence number", "Number (class 4)."),
        (0x8b, "reassignment time", "Seconds (classes 1 and 3)."),
        (0x8c, "flow control confirmation", "Lower window edge (4), your subsequence (2), your credit (2)."),
        (0xc0, "TPDU size", "Exponent n: 2^n bytes, 0x07 = 128 to 0x0d = 8192."),
        (0xc1, "calling TSAP (CR, CC); invalid TPDU (ER)", "TSAP bytes; in ER the rejected header up to and including the bad byte."),
        (0xc2, "called TSAP", "TSAP bytes."),
        (0xc3, "checksum", "Fletcher checksum."),
        (0xc4, "version number", "0x01."),
        (0xc5, "protection (security)", "User defined."),
        (0xc6, "additional option selection", "Bit 1 transport expedited data, bit 2 no checksum (class 4), bit 3 receipt confirmation (class 1), bit 4 network expedited (class 1); RFC 2126 class 2: bit 4 reverse connection, bit 6 expedited acknowledgement, bit 7 non-blocking expedited."),
        (0xc7, "alternative protocol classes", "One byte per class, class in the high nibble."),
        (0xe0, "additional information on clearing", "User defined."),
        (0xf0, "preferred maximum TPDU size", "Size in units of 128 bytes."),
        (0xf2, "inactivity timer", "Milliseconds (class 4)."),
    ],
)

DR_REASONS: Final = CodeTable(
    "COTP disconnect reason",
    2,
    [
        (0x00, "reason not specified", "Classes: all."),
        (0x01, "congestion at TSAP", "Classes: all."),
        (0x02, "session entity not attached to TSAP", "Classes: all."),
        (0x03, "address unknown", "Classes: all."),
        (0x80, "normal disconnect by the session entity", "Classes: 1-4."),
        (0x81, "remote transport entity congested at connect request", "Classes: 1-4."),
        (0x82, "connection negotiation failed (proposed classes not supported)", "Classes: 1-4."),
        (0x83, "duplicate source reference for the same pair of NSAPs", "Classes: 1-4."),
        (0x84, "mismatched references", "Classes: 1-4."),
        (0x85, "protocol error", "Classes: 1-4."),
        (0x86, "not used", "Classes: -."),
        (0x87, "reference overflow", "Classes: 1-4."),
        (0x88, "connection request refused on this network connection", "Classes: 1-4."),
        (0x89, "not used", "Classes: -."),
        (0x8a, "header or parameter length invalid", "Classes: 1-4."),
    ],
)

ER_CAUSES: Final = CodeTable(
    "COTP reject cause",
    2,
    [
        (0x00, "reason not specified", "No cause given."),
        (0x01, "invalid parameter code", "A parameter code is not allowed."),
        (0x02, "invalid TPDU type", "The TPDU type is not known or not allowed here."),
        (0x03, "invalid parameter value", "A parameter holds a value that is not allowed."),
    ],
)

CONNECTION_TYPES: Final = CodeTable(
    "TSAP connection type",
    2,
    [
        (0x01, "PG", "Programming device."),
        (0x02, "OP", "Operator panel or HMI."),
        (0x03, "S7 basic", "S7 basic communication or other."),
    ],
)

