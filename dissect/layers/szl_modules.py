"""Records about modules and stations as Scapy packets (`dissect.s7.szl_modules`)."""

from __future__ import annotations

from dissect.layers.fields import header_fields
from dissect.layers.parts import S7_Part
from dissect.s7 import szl_modules

__all__ = [
    "S7_SZLDpMaster",
    "S7_SZLDpMasterExtended",
    "S7_SZLManyStations",
    "S7_SZLModuleStatus",
    "S7_SZLStations",
    "S7_SZLSubmoduleStatus",
    "S7_SZLSwitchedSlave",
]


class S7_SZLSwitchedSlave(S7_Part):
    """Switched DP slave."""

    name = "S7 switched DP slave"
    layout = szl_modules.SWITCHED_SLAVE
    fields_desc = header_fields(szl_modules.SWITCHED_SLAVE)


class S7_SZLDpMaster(S7_Part):
    """DP master system."""

    name = "S7 DP master system"
    layout = szl_modules.DP_MASTER
    fields_desc = header_fields(szl_modules.DP_MASTER)


class S7_SZLDpMasterExtended(S7_Part):
    """Extended DP master system."""

    name = "S7 extended DP master system"
    layout = szl_modules.DP_MASTER_EXTENDED
    fields_desc = header_fields(szl_modules.DP_MASTER_EXTENDED)


class S7_SZLModuleStatus(S7_Part):
    """Module status."""

    name = "S7 module status"
    layout = szl_modules.MODULE_STATUS
    fields_desc = header_fields(szl_modules.MODULE_STATUS)


class S7_SZLStations(S7_Part):
    """Rack and station status."""

    name = "S7 rack and station status"
    layout = szl_modules.STATIONS
    fields_desc = header_fields(szl_modules.STATIONS)


class S7_SZLManyStations(S7_Part):
    """Rack and station status, PROFIBUS DP and PROFINET."""

    name = "S7 rack and station status, PROFIBUS DP and PROFINET"
    layout = szl_modules.MANY_STATIONS
    fields_desc = header_fields(szl_modules.MANY_STATIONS)


class S7_SZLSubmoduleStatus(S7_Part):
    """Module status, PROFINET IO and PROFIBUS DP."""

    name = "S7 module status, PROFINET IO and PROFIBUS DP"
    layout = szl_modules.SUBMODULE_STATUS
    fields_desc = header_fields(szl_modules.SUBMODULE_STATUS)
