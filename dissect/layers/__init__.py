"""Scapy layers for TPKT, COTP and S7comm, and for IBH-NetLink. Importing this package binds them to TCP ports 102 and 1099.

Craft: lengths, counts and fill octets are filled in if they are left out. ::

    from dissect.layers import COTP_CR, COTP_DT, S7, TPKT, COTP_Parameter, S7_ReadVarRequest, S7Session, at
    connect = TPKT() / COTP_CR(src_ref=1, parameters=[
        COTP_Parameter.tpdu_size(1024), COTP_Parameter.calling("01.00"), COTP_Parameter.called("01.02")])
    read = TPKT() / COTP_DT() / S7(pdu_ref=0x200) / S7_ReadVarRequest(items=[at("DB10.DBW4", 3)])
    bytes(read).hex()  # 0300001f02f080320100000200000e00000401120a10040003000a84000020

Dissect: never raises, loses no octet, and finds several TPKTs in one segment. ::

    TPKT(bytes(read)).summary()  # TPKT / COTP_DT / S7 Job Read Var ref=0x0200 DB10.DBW4 x3
    packet.getlayer(TPKT, 2)[S7].pdu_ref  # of a packet whose segment holds two

Read a capture on this package's own reassembly, one packet for each TPDU::

    for packet in sniff(offline="plant.pcapng", session=S7Session):
        print(packet.summary())

`bind_port` adds another TCP port; `bind_scd` binds `SCD`, which has no port of its own. ``docs/layers.md`` is the longer
tutorial.
"""

from __future__ import annotations

import sys

from dissect.layers import part_classes, syntaxes
from dissect.layers.cotp import (
    COTP,
    COTP_AK,
    COTP_CC,
    COTP_CR,
    COTP_DC,
    COTP_DR,
    COTP_DT,
    COTP_EA,
    COTP_ED,
    COTP_ER,
    COTP_RJ,
    COTP_AK_Extended,
    COTP_DT_Extended,
    COTP_DT_Normal,
    COTP_EA_Extended,
    COTP_ED_Extended,
    COTP_ED_Normal,
    COTP_RJ_Extended,
    COTP_Unknown,
)
from dissect.layers.explore import show_in_scapy
from dissect.layers.ibh import IBH, MPI, IBH_Rest, MPI_Long
from dissect.layers.notation import at
from dissect.layers.parameters import COTP_Parameter
from dissect.layers.part_classes import *  # noqa: F403  # a class for each structure; its __all__ names them
from dissect.layers.parts import S7_Part
from dissect.layers.plus_messages import plus_frames, plus_message, plus_parts, plus_reply
from dissect.layers.s7 import S7, S7_Answer, S7_Body, S7_Data, S7_Function, S7_Job, S7_Setup
from dissect.layers.s7plus import (
    S7Plus,
    S7Plus_Event,
    S7Plus_KeepAlive,
    S7Plus_Notification,
    S7Plus_NotificationV1,
    S7Plus_Request,
    S7Plus_Response,
)
from dissect.layers.scd import SCD, bind_scd, unbind_scd
from dissect.layers.session import S7Session
from dissect.layers.syntaxes import *  # noqa: F403
from dissect.layers.tpkt import TPKT, TPKT_Rest, bind_port
from dissect.layers.userdata import (
    S7_USEND,
    S7_ModeTransition,
    S7_Password,
    S7_Userdata,
    S7_UserdataExtended,
    S7_UserdataShort,
)
from dissect.layers.variables import (
    S7_Any,
    S7_DataItem,
    S7_Item,
    S7_OtherItem,
    S7_ReadVarAnswer,
    S7_ReadVarRequest,
    S7_WriteDataItem,
    S7_WriteVarAnswer,
    S7_WriteVarRequest,
)

__all__ = [
    "COTP",
    "COTP_AK",
    "COTP_CC",
    "COTP_CR",
    "COTP_DC",
    "COTP_DR",
    "COTP_DT",
    "COTP_EA",
    "COTP_ED",
    "COTP_ER",
    "COTP_RJ",
    "IBH",
    "MPI",
    "S7",
    "S7_USEND",
    "SCD",
    "TPKT",
    "COTP_AK_Extended",
    "COTP_DT_Extended",
    "COTP_DT_Normal",
    "COTP_EA_Extended",
    "COTP_ED_Extended",
    "COTP_ED_Normal",
    "COTP_Parameter",
    "COTP_RJ_Extended",
    "COTP_Unknown",
    "IBH_Rest",
    "MPI_Long",
    "S7Plus",
    "S7Plus_Event",
    "S7Plus_KeepAlive",
    "S7Plus_Notification",
    "S7Plus_NotificationV1",
    "S7Plus_Request",
    "S7Plus_Response",
    "S7Session",
    "S7_Answer",
    "S7_Any",
    "S7_Body",
    "S7_Data",
    "S7_DataItem",
    "S7_Function",
    "S7_Item",
    "S7_Job",
    "S7_ModeTransition",
    "S7_OtherItem",
    "S7_Part",
    "S7_Password",
    "S7_ReadVarAnswer",
    "S7_ReadVarRequest",
    "S7_Setup",
    "S7_Userdata",
    "S7_UserdataExtended",
    "S7_UserdataShort",
    "S7_WriteDataItem",
    "S7_WriteVarAnswer",
    "S7_WriteVarRequest",
    "TPKT_Rest",
    "at",
    "bind_port",
    "bind_scd",
    "plus_frames",
    "plus_message",
    "plus_parts",
    "plus_reply",
    "unbind_scd",
]
__all__ += part_classes.__all__
__all__ += syntaxes.__all__

show_in_scapy(sys.modules[__name__])
