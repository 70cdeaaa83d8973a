"""Programmable block communication, BSEND and USEND: programs send to programs (userdata group 6, reference section 4.10)."""

from __future__ import annotations

from typing import Final

from dissect.s7.data_parts import take_data_items
from dissect.s7.layouts import DATA_ITEM, USERDATA_SHORT
from dissect.s7.parameters import UserdataHead
from dissect.s7.syntaxes import PBC_ID, R_ID_FIELDS, r_id_text
from dissect.wire.layout import REST, Field, Layout
from dissect.wire.octets import u16
from dissect.wire.part import Cursor

BSEND: Final = 1

_SOURCE: Final = "reference section 4.10"

#: Before the first piece of a BSEND only.
BSEND_LENGTH: Final = Layout(
    "BSEND length",
    _SOURCE,
    [Field("total_length", 2, "Octets of all pieces.", "s7comm.pbc.req.bsend.len", decimal=True)],
)
BSEND_DATA: Final = Layout(
    "BSEND data", _SOURCE, [Field("bsend_data", REST, "As the program sent them.", "s7comm.data.userdata")]
)
#: Parameters of a USEND: the R_ID stands where others have type, group and subfunction.
USEND_HEAD: Final = Layout("USEND", _SOURCE, [*USERDATA_SHORT.fields[:5], *R_ID_FIELDS])
#: Before the data items of a USEND.
USEND_DATA: Final = Layout(
    "USEND data",
    _SOURCE,
    [
        DATA_ITEM.fields[0],
        Field("unknown", 1, "Unknown."),
        Field("item_count", 2, "Up to four data items.", "s7comm.param.itemcount", counts=DATA_ITEM.name),
    ],
)


def parse_bsend(cursor: Cursor, head: UserdataHead) -> None:
    """Cut a piece of a BSEND, in a request or a push; the partner's answers carry nothing.

    The first piece of several, and one that is alone, begin with the length of all. A piece between the first and the last
    is not marked, so one is taken for the first when its length can be that of more than is here.
    """
    part = cursor.take(PBC_ID)
    if part is None:
        return
    part.note = r_id_text(part.number("r_id"))
    left = cursor.left
    more = head.more and left >= BSEND_LENGTH.size and u16(cursor.octets, cursor.at) > left - BSEND_LENGTH.size
    if not head.data_unit_ref or more:
        length = cursor.take(BSEND_LENGTH)
        if length is not None:
            length.note = f"{length.number('total_length')} octets"
            if not more and length.number("total_length") > cursor.left:
                cursor.tell("length_beyond", "total_length", length.number("total_length"), cursor.left)
    if cursor.left:
        cursor.take(BSEND_DATA, note="" if more or not head.data_unit_ref else "continuation")


def take_usend(cursor: Cursor) -> None:
    """Cut the parameters of a USEND."""
    part = cursor.take(USEND_HEAD)
    if part is not None:
        part.note = f"USEND {r_id_text(part.number('r_id'))}"


def take_usend_data(cursor: Cursor) -> None:
    """Cut the data block of a USEND."""
    head = cursor.take(USEND_DATA)
    if head is not None:
        take_data_items(cursor, head.number("item_count"), False)
