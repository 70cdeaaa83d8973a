"""Programmable block communication, BSEND and USEND between two programs (userdata group 6, reference section 4.10)."""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7.data_parts import take_data_items
from dissect.protocols.s7.layouts import DATA_ITEM, USERDATA_SHORT
from dissect.protocols.s7.parameters import UserdataHead
from dissect.protocols.s7.syntaxes import PBC_ID, R_ID_FIELDS, r_id_text
from dissect.wire.layout import HOLDS_VALUE, REST, Field, Layout
from dissect.wire.part import Cursor

_SOURCE: Final = "reference section 4.10"

#: Precedes the first piece of a BSEND only.
BSEND_LENGTH: Final = Layout(
    "BSEND length",
    _SOURCE,
    [Field("total_length", 2, "Bytes of all pieces.", "s7comm.pbc.req.bsend.len", decimal=True)],
)
BSEND_DATA: Final = Layout(
    "BSEND data",
    _SOURCE,
    [Field("bsend_data", REST, "As the program sent them.", "s7comm.data.userdata", holds=HOLDS_VALUE)],
)
#: Parameters of a USEND: the R_ID is where other userdata have type, group and subfunction.
USEND_HEAD: Final = Layout("USEND", _SOURCE, [*USERDATA_SHORT.fields[:5], *R_ID_FIELDS])
#: Precedes the data items of a USEND.
USEND_DATA: Final = Layout(
    "USEND data",
    _SOURCE,
    [
        DATA_ITEM.fields[0],
        Field("unknown", 1, "Unknown."),
        Field("item_count", 2, "Up to four data items.", "s7comm.param.itemcount", counts=DATA_ITEM.name),
    ],
)


def goes_on(head: UserdataHead) -> bool:
    """Return whether a piece of a BSEND continues an earlier piece.

    A new BSEND has sequence number 0, like every new request. Its further pieces have the number that the partner assigned in
    its answer to the first piece. All pieces of a BSEND with several pieces have a data unit reference; in captures each piece
    has a different one.
    """
    return head.sequence != 0 and head.data_unit_ref != 0


def parse_bsend(cursor: Cursor, head: UserdataHead) -> None:
    """Parse a piece of a BSEND in a request or a push; answers of the partner have no data.

    The first piece, perhaps the only one, begins with the total length.
    """
    part = cursor.take(PBC_ID)
    if part is None:
        return
    part.note = r_id_text(part.number("r_id"))
    follows = goes_on(head)
    if not follows:
        length = cursor.take(BSEND_LENGTH)
        if length is not None:
            length.note = f"{length.number('total_length')} bytes"
            if not head.more and length.number("total_length") > cursor.left:
                cursor.tell("length_beyond", "total_length", length.number("total_length"), cursor.left)
    if cursor.left:
        cursor.take(BSEND_DATA, note="continuation" if follows else "")


def take_usend(cursor: Cursor) -> None:
    """Parse the parameters of a USEND."""
    part = cursor.take(USEND_HEAD)
    if part is not None:
        part.note = f"USEND {r_id_text(part.number('r_id'))}"


def take_usend_data(cursor: Cursor) -> None:
    """Parse the data block of a USEND."""
    head = cursor.take(USEND_DATA)
    if head is not None:
        take_data_items(cursor, head.number("item_count"), False)
