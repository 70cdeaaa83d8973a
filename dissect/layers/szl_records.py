"""Records of system status lists as Scapy packets (`dissect.s7.szl_records`)."""

from __future__ import annotations

from dissect.layers.fields import header_fields
from dissect.layers.parts import S7_Part
from dissect.s7 import diagnostics, szl_records

__all__ = [
    "S7_SZLLED",
    "S7_DiagnosticEvent",
    "S7_SZLBlockType",
    "S7_SZLCharacteristic",
    "S7_SZLComponent",
    "S7_SZLCopyright",
    "S7_SZLEthernet",
    "S7_SZLHSystem",
    "S7_SZLId",
    "S7_SZLIdentification",
    "S7_SZLInterruptStatus",
    "S7_SZLLocation",
    "S7_SZLManufacturer",
    "S7_SZLMemoryArea",
    "S7_SZLMemoryCard",
    "S7_SZLModuleName",
    "S7_SZLModuleType",
    "S7_SZLOem",
    "S7_SZLOperatingMode",
    "S7_SZLPlantDesignation",
    "S7_SZLProcessImagePartition",
    "S7_SZLRecord",
    "S7_SZLRecordRest",
    "S7_SZLSerialNumber",
    "S7_SZLSystemArea",
    "S7_SZLSystemName",
]


class S7_DiagnosticEvent(S7_Part):
    """An entry of the diagnostic buffer."""

    name = "S7 diagnostic event"
    layout = diagnostics.DIAGNOSTIC_EVENT
    fields_desc = header_fields(diagnostics.DIAGNOSTIC_EVENT)


class S7_SZLRecord(S7_Part):
    """A record of a list whose records are not known."""

    name = "S7 SZL record"
    layout = szl_records.RECORD
    fields_desc = header_fields(szl_records.RECORD)


class S7_SZLRecordRest(S7_Part):
    """What a record has behind the fields that are known."""

    name = "S7 rest of the SZL record"
    layout = szl_records.RECORD_REST
    fields_desc = header_fields(szl_records.RECORD_REST)


class S7_SZLId(S7_Part):
    """SZL id of the module."""

    name = "S7 SZL id of the module"
    layout = szl_records.SZL_ID
    fields_desc = header_fields(szl_records.SZL_ID)


class S7_SZLIdentification(S7_Part):
    """Module identification."""

    name = "S7 module identification"
    layout = szl_records.IDENTIFICATION
    fields_desc = header_fields(szl_records.IDENTIFICATION)


class S7_SZLCharacteristic(S7_Part):
    """CPU characteristic."""

    name = "S7 CPU characteristic"
    layout = szl_records.CHARACTERISTIC
    fields_desc = header_fields(szl_records.CHARACTERISTIC)


class S7_SZLMemoryArea(S7_Part):
    """User memory area."""

    name = "S7 user memory area"
    layout = szl_records.MEMORY_AREA
    fields_desc = header_fields(szl_records.MEMORY_AREA)


class S7_SZLSystemArea(S7_Part):
    """System area."""

    name = "S7 system area"
    layout = szl_records.SYSTEM_AREA
    fields_desc = header_fields(szl_records.SYSTEM_AREA)


class S7_SZLBlockType(S7_Part):
    """Block type."""

    name = "S7 block type"
    layout = szl_records.BLOCK_TYPE
    fields_desc = header_fields(szl_records.BLOCK_TYPE)


class S7_SZLLED(S7_Part):
    """LED."""

    name = "S7 LED"
    layout = szl_records.LED
    fields_desc = header_fields(szl_records.LED)


class S7_SZLInterruptStatus(S7_Part):
    """Interrupt status."""

    name = "S7 interrupt status"
    layout = szl_records.INTERRUPT_STATUS
    fields_desc = header_fields(szl_records.INTERRUPT_STATUS)


class S7_SZLOperatingMode(S7_Part):
    """Operating mode."""

    name = "S7 operating mode"
    layout = szl_records.OPERATING_MODE
    fields_desc = header_fields(szl_records.OPERATING_MODE)


class S7_SZLProcessImagePartition(S7_Part):
    """Process image partition."""

    name = "S7 process image partition"
    layout = szl_records.PROCESS_IMAGE_PARTITION
    fields_desc = header_fields(szl_records.PROCESS_IMAGE_PARTITION)


class S7_SZLEthernet(S7_Part):
    """Ethernet interface."""

    name = "S7 Ethernet interface"
    layout = szl_records.ETHERNET
    fields_desc = header_fields(szl_records.ETHERNET)


class S7_SZLHSystem(S7_Part):
    """H system."""

    name = "S7 H system"
    layout = szl_records.H_SYSTEM
    fields_desc = header_fields(szl_records.H_SYSTEM)


class S7_SZLSystemName(S7_Part):
    """Component: name of the station."""

    name = "S7 component: name of the station"
    layout = szl_records.COMPONENT_RECORDS[1]
    fields_desc = header_fields(szl_records.COMPONENT_RECORDS[1], {"index": 1})


class S7_SZLModuleName(S7_Part):
    """Component: name of the module."""

    name = "S7 component: name of the module"
    layout = szl_records.COMPONENT_RECORDS[2]
    fields_desc = header_fields(szl_records.COMPONENT_RECORDS[2], {"index": 2})


class S7_SZLPlantDesignation(S7_Part):
    """Component: plant designation."""

    name = "S7 component: plant designation"
    layout = szl_records.COMPONENT_RECORDS[3]
    fields_desc = header_fields(szl_records.COMPONENT_RECORDS[3], {"index": 3})


class S7_SZLCopyright(S7_Part):
    """Component: copyright."""

    name = "S7 component: copyright"
    layout = szl_records.COMPONENT_RECORDS[4]
    fields_desc = header_fields(szl_records.COMPONENT_RECORDS[4], {"index": 4})


class S7_SZLSerialNumber(S7_Part):
    """Component: serial number."""

    name = "S7 component: serial number"
    layout = szl_records.COMPONENT_RECORDS[5]
    fields_desc = header_fields(szl_records.COMPONENT_RECORDS[5], {"index": 5})


class S7_SZLModuleType(S7_Part):
    """Component: module type."""

    name = "S7 component: module type"
    layout = szl_records.COMPONENT_RECORDS[7]
    fields_desc = header_fields(szl_records.COMPONENT_RECORDS[7], {"index": 7})


class S7_SZLMemoryCard(S7_Part):
    """Component: serial number of the memory card."""

    name = "S7 component: serial number of the memory card"
    layout = szl_records.COMPONENT_RECORDS[8]
    fields_desc = header_fields(szl_records.COMPONENT_RECORDS[8], {"index": 8})


class S7_SZLManufacturer(S7_Part):
    """Component: manufacturer and profile."""

    name = "S7 component: manufacturer and profile"
    layout = szl_records.COMPONENT_RECORDS[9]
    fields_desc = header_fields(szl_records.COMPONENT_RECORDS[9], {"index": 9})


class S7_SZLOem(S7_Part):
    """Component: OEM."""

    name = "S7 component: OEM"
    layout = szl_records.COMPONENT_RECORDS[10]
    fields_desc = header_fields(szl_records.COMPONENT_RECORDS[10], {"index": 10})


class S7_SZLLocation(S7_Part):
    """Component: location designation."""

    name = "S7 component: location designation"
    layout = szl_records.COMPONENT_RECORDS[11]
    fields_desc = header_fields(szl_records.COMPONENT_RECORDS[11], {"index": 11})


class S7_SZLComponent(S7_Part):
    """A component without a meaning that is known."""

    name = "S7 component"
    layout = szl_records.COMPONENT
    fields_desc = header_fields(szl_records.COMPONENT)
