"""Start information of organisation blocks as Scapy packets (`dissect.s7.start_information`)."""

from __future__ import annotations

from dissect.layers.fields import header_fields
from dissect.layers.parts import S7_Part
from dissect.s7 import start_information

__all__ = [
    "S7_StartOB1",
    "S7_StartOB10",
    "S7_StartOB20",
    "S7_StartOB30",
    "S7_StartOB40",
    "S7_StartOB55",
    "S7_StartOB80",
    "S7_StartOB81",
    "S7_StartOB82",
    "S7_StartOB83",
    "S7_StartOB84",
    "S7_StartOB85",
    "S7_StartOB86",
    "S7_StartOB87",
    "S7_StartOB90",
    "S7_StartOB100",
    "S7_StartOB121",
    "S7_StartOB122",
    "S7_StartOther",
]


class S7_StartOther(S7_Part):
    """Of an OB that is not in `START_INFORMATION`."""

    name = "S7 start information"
    layout = start_information.OTHER_START
    fields_desc = header_fields(start_information.OTHER_START)


class S7_StartOB1(S7_Part):
    """Start information of OB 1."""

    name = "S7 start information of OB 1"
    layout = start_information.START_INFORMATION[1]
    fields_desc = header_fields(start_information.START_INFORMATION[1])


class S7_StartOB10(S7_Part):
    """Start information of OB 10 and those like it."""

    name = "S7 start information of OB 10"
    layout = start_information.START_INFORMATION[10]
    fields_desc = header_fields(start_information.START_INFORMATION[10])


class S7_StartOB20(S7_Part):
    """Start information of OB 20 and those like it."""

    name = "S7 start information of OB 20"
    layout = start_information.START_INFORMATION[20]
    fields_desc = header_fields(start_information.START_INFORMATION[20])


class S7_StartOB30(S7_Part):
    """Start information of OB 30 and those like it."""

    name = "S7 start information of OB 30"
    layout = start_information.START_INFORMATION[30]
    fields_desc = header_fields(start_information.START_INFORMATION[30])


class S7_StartOB40(S7_Part):
    """Start information of OB 40 and those like it."""

    name = "S7 start information of OB 40"
    layout = start_information.START_INFORMATION[40]
    fields_desc = header_fields(start_information.START_INFORMATION[40])


class S7_StartOB55(S7_Part):
    """Start information of OB 55 and those like it."""

    name = "S7 start information of OB 55"
    layout = start_information.START_INFORMATION[55]
    fields_desc = header_fields(start_information.START_INFORMATION[55])


class S7_StartOB80(S7_Part):
    """Start information of OB 80."""

    name = "S7 start information of OB 80"
    layout = start_information.START_INFORMATION[80]
    fields_desc = header_fields(start_information.START_INFORMATION[80])


class S7_StartOB81(S7_Part):
    """Start information of OB 81."""

    name = "S7 start information of OB 81"
    layout = start_information.START_INFORMATION[81]
    fields_desc = header_fields(start_information.START_INFORMATION[81])


class S7_StartOB82(S7_Part):
    """Start information of OB 82."""

    name = "S7 start information of OB 82"
    layout = start_information.START_INFORMATION[82]
    fields_desc = header_fields(start_information.START_INFORMATION[82])


class S7_StartOB83(S7_Part):
    """Start information of OB 83."""

    name = "S7 start information of OB 83"
    layout = start_information.START_INFORMATION[83]
    fields_desc = header_fields(start_information.START_INFORMATION[83])


class S7_StartOB84(S7_Part):
    """Start information of OB 84."""

    name = "S7 start information of OB 84"
    layout = start_information.START_INFORMATION[84]
    fields_desc = header_fields(start_information.START_INFORMATION[84])


class S7_StartOB85(S7_Part):
    """Start information of OB 85."""

    name = "S7 start information of OB 85"
    layout = start_information.START_INFORMATION[85]
    fields_desc = header_fields(start_information.START_INFORMATION[85])


class S7_StartOB86(S7_Part):
    """Start information of OB 86."""

    name = "S7 start information of OB 86"
    layout = start_information.START_INFORMATION[86]
    fields_desc = header_fields(start_information.START_INFORMATION[86])


class S7_StartOB87(S7_Part):
    """Start information of OB 87."""

    name = "S7 start information of OB 87"
    layout = start_information.START_INFORMATION[87]
    fields_desc = header_fields(start_information.START_INFORMATION[87])


class S7_StartOB90(S7_Part):
    """Start information of OB 90."""

    name = "S7 start information of OB 90"
    layout = start_information.START_INFORMATION[90]
    fields_desc = header_fields(start_information.START_INFORMATION[90])


class S7_StartOB100(S7_Part):
    """Start information of OB 100 and those like it."""

    name = "S7 start information of OB 100"
    layout = start_information.START_INFORMATION[100]
    fields_desc = header_fields(start_information.START_INFORMATION[100])


class S7_StartOB121(S7_Part):
    """Start information of OB 121."""

    name = "S7 start information of OB 121"
    layout = start_information.START_INFORMATION[121]
    fields_desc = header_fields(start_information.START_INFORMATION[121])


class S7_StartOB122(S7_Part):
    """Start information of OB 122."""

    name = "S7 start information of OB 122"
    layout = start_information.START_INFORMATION[122]
    fields_desc = header_fields(start_information.START_INFORMATION[122])
