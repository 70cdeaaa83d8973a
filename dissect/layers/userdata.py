"""Userdata (ROSCTR 7) as Scapy layers: the parameter head in its three forms, the payload as octets (reference section 4)."""

from __future__ import annotations

from typing import Final

from scapy.packet import Packet, bind_top_down

from dissect.layers.fields import ItemsField, ScapyField, header_fields
from dissect.layers.s7 import S7, USERDATA_BODIES, S7_Body, body_fields, error_text
from dissect.layers.variables import S7_DataItem, carve_data
from dissect.s7 import layouts, tables
from dissect.s7.items import SPECIFICATION

_REQUEST: Final = 1
_RESPONSE: Final = 2
_SHORT: Final = 0x11
_EXTENDED: Final = 0x12
#: Syntax id of USEND, which puts its R_ID where other PDUs have the extended head.
_USEND: Final = 0x13


class S7_Userdata(S7_Body):
    """Userdata: `S7_UserdataShort` or `S7_UserdataExtended`. ``data`` is one data item, whose octets are the payload."""

    name = "S7 userdata"
    data_fields = ("data", "data_rest")

    def responds_to(self, other: Packet) -> bool:
        """Tell whether this is a response and ``other`` a request of the same group and subfunction."""
        return (
            isinstance(other, S7_Userdata)
            and self.type == _RESPONSE
            and other.type == _REQUEST
            and (self.group, self.subfunction) == (other.group, other.subfunction)
        )

    def describe(self) -> str:
        """Return type, group and subfunction by name."""
        names = tables.USERDATA_SUBFUNCTIONS.get(self.group)
        subfunction = names.name(self.subfunction) if names is not None else f"0x{self.subfunction:02x}"
        return f"{tables.USERDATA_TYPES.name(self.type)} {tables.USERDATA_GROUPS.name(self.group)}: {subfunction}"


def _userdata_data() -> list[ScapyField]:
    return [ItemsField("data", carve_data(S7_DataItem, False, lambda _: 1))]


_USERDATA_DEFAULTS: Final = {"item_count": 1, "specification": SPECIFICATION, "group": 4, "subfunction": 1}


class S7_UserdataShort(S7_Userdata):
    """Userdata with the short parameter head: most requests, and the pushes of group 4."""

    name = "S7 userdata (short)"
    least = layouts.USERDATA_SHORT.size
    fields_desc = body_fields(
        *header_fields(
            layouts.USERDATA_SHORT, {**_USERDATA_DEFAULTS, "length": 4, "syntax_id": _SHORT, "type": _REQUEST}
        ),
        data=_userdata_data(),
    )


class S7_UserdataExtended(S7_Userdata):
    """Userdata with the extended parameter head: answers, follow-up requests, most pushes."""

    name = "S7 userdata (extended)"
    least = layouts.USERDATA_EXTENDED.size
    fields_desc = body_fields(
        *header_fields(
            layouts.USERDATA_EXTENDED, {**_USERDATA_DEFAULTS, "length": 8, "syntax_id": _EXTENDED, "type": _RESPONSE}
        ),
        data=_userdata_data(),
    )

    @classmethod
    def suits(cls, parameters: bytes) -> bool:
        """Tell by the length octet of the head, and by the syntax id, which is another in a USEND."""
        long_enough = super().suits(parameters) and parameters[3] >= layouts.USERDATA_EXTENDED.size - 4
        return long_enough and parameters[4] != _USEND

    def detail(self) -> str:
        """Return why it was refused, if it was."""
        return f"error {error_text(self.error_code)}" if self.error_code else ""


class S7_ModeTransition(S7_Body):
    """The push that tells a change of the operating mode: userdata with a parameter block of its own."""

    name = "S7 mode transition"
    least = layouts.MODE_TRANSITION.size
    fields_desc = body_fields(
        *header_fields(layouts.MODE_TRANSITION, {"function": tables.MODE_TRANSITION, "unknown": 0x10100000})
    )

    @classmethod
    def suits(cls, parameters: bytes) -> bool:
        """Tell by the function."""
        return super().suits(parameters) and parameters[0] == tables.MODE_TRANSITION

    def detail(self) -> str:
        """Return the new mode."""
        return str(tables.USERDATA_SUBFUNCTIONS[0].name(self.mode))


USERDATA_BODIES.extend((S7_ModeTransition, S7_UserdataExtended, S7_UserdataShort))
for _body in USERDATA_BODIES:
    bind_top_down(S7, _body, rosctr=tables.USERDATA)
