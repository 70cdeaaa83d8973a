"""Records of the lists of modules, racks, stations and bus masters (SZL 0x75, 0x90 to 0x96 and 0xB1 to 0xB3).

From the Siemens manual of system and standard functions; positions compared with Wireshark where it has them.
"""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7.szl_communication import flags, reserved
from dissect.protocols.s7.szl_tables import ADDRESS_KINDS, DIAGNOSED_MODULES, MODULE_AREAS
from dissect.wire.layout import HOLDS_NUMBER, REST, Field, Layout

_MANUAL: Final = "Siemens system status list"


def bits_set(octets: bytes) -> str | None:
    """Return the numbers of the set bits, from 0; the list determines which rack or station a bit represents."""
    numbers = [str(8 * at + bit) for at, octet in enumerate(octets) for bit in range(8) if octet >> bit & 1]
    return f"bit{'s' if len(numbers) > 1 else ''} {', '.join(numbers)}" if numbers else "none"


SWITCHED_SLAVE: Final = Layout(
    "switched DP slave",
    _MANUAL,
    [
        Field("rack_0_station", 2, "Master in rack 0: DP master system and station."),
        Field("rack_0_slot", 2, "Master in rack 0: slot and submodule slot."),
        Field("rack_1_station", 2, "Master in rack 1: DP master system and station."),
        Field("rack_1_slot", 2, "Master in rack 1: slot and submodule slot."),
        reserved("reserved", 4),
        Field("address", 2, "Diagnostic address, bit 15 output."),
        Field("slave_status", 2, "Communication status."),
    ],
)

_DP_MASTER: Final = [
    Field("system_id", 1, "DP master system or PROFINET IO system.", decimal=True),
    Field("rack", 1, "Rack of the master.", decimal=True),
    Field("slot", 1, "Slot of the master, or of the CPU.", decimal=True),
    Field("interface", 1, "1 X2, 2 X1, 3 IF1, 4 IF2; 0 external."),
    Field("address", 2, "Logical start address."),
    Field("reserved_cpu", 2, "Reserved."),
    Field("reserved_master", 2, "Reserved."),
    Field("properties", 1, "Bit 0 DPV1, 1 equidistant, 7 external master."),
]
DP_MASTER: Final = Layout("DP master system", _MANUAL, [*_DP_MASTER, reserved("reserved", 3)])
DP_MASTER_EXTENDED: Final = Layout(
    "extended DP master system",
    _MANUAL,
    [
        *_DP_MASTER,
        Field("station", 1, "PROFIBUS address.", decimal=True),
        reserved("reserved_2", 2),
        Field("ob", 1, "OB of the synchronous cycle interrupt.", decimal=True),
        Field("reserved_3", 1, "Reserved."),
        Field("bit_rate", 4, "Transmission rate."),
        Field("cycle", 4, "Period of the equidistant cycle in us.", decimal=True),
        reserved("reserved", 16),
    ],
)

_MODULE: Final = "s7comm.szl.0091.0000"
MODULE_STATUS: Final = Layout(
    "module status",
    _MANUAL,
    [
        Field("place", 2, "Rack, or DP master system and station.", f"{_MODULE}.adr1"),
        Field("slot", 2, "Slot and submodule slot.", f"{_MODULE}.adr2"),
        Field("address", 2, "First logical address.", f"{_MODULE}.logadr", decimal=True),
        Field("expected_type", 2, "Type that was configured.", f"{_MODULE}.exptype"),
        Field("actual_type", 2, "Type that is there.", f"{_MODULE}.acttype"),
        Field("interface_modules", 2, "Number of interface modules, or reserved.", f"{_MODULE}.res1"),
        Field("address_kind", 2, "What the address is of.", f"{_MODULE}.eastat.dataid", ADDRESS_KINDS, (0xFF00, 8)),
        *flags(f"{_MODULE}.eastat", "local_segment=modlocseg - cir_busy=cirbusy station_error=staterr"
               " disabled=moddisabl not_available=modnotav exists=modexists error=moderror", octets=2, shared=True),
        Field("area", 2, "Area of the module.", f"{_MODULE}.berbgbr.areaid", MODULE_AREAS, (0x0070, 4)),
        Field("width", 2, "Width of the module.", f"{_MODULE}.berbgbr.width", None, (0x0007, 0), True, decimal=True),
    ],
)  # fmt: skip

STATIONS: Final = Layout(
    "rack and station status",
    _MANUAL,
    [
        Field(
            "stations", 16, "One bit for each: bit 0 the central rack or station 1.", means=bits_set, holds=HOLDS_NUMBER
        )
    ],
)
MANY_STATIONS: Final = Layout(
    "rack and station status, PROFIBUS DP and PROFINET",
    _MANUAL,
    [
        Field("index", 2, "DP or PROFINET IO system, 0 central.", "s7comm.szl.0094.xxxx.index"),
        Field(
            "stations",
            REST,
            "Bit 0 group information, bit 1 the central rack or station 1, and so on.",
            means=bits_set,
            holds=HOLDS_NUMBER,
        ),
    ],
)

_SUBMODULE: Final = "s7comm.szl.xx96.xxxx"
SUBMODULE_STATUS: Final = Layout(
    "module status, PROFINET IO and PROFIBUS DP",
    _MANUAL,
    [
        Field("output", 2, "1 output address.", f"{_SUBMODULE}.logadr.area", None, (0x8000, 15)),
        Field("address", 2, "Logical address.", f"{_SUBMODULE}.logadr.adr", None, (0x7FFF, 0), True),
        Field("system", 2, "DP master or PROFINET IO system.", f"{_SUBMODULE}.system", decimal=True),
        Field("profile", 4, "API: application profile.", f"{_SUBMODULE}.api"),
        Field("station", 2, "Rack, station or device.", f"{_SUBMODULE}.station", decimal=True),
        Field("slot", 2, "Slot.", f"{_SUBMODULE}.slot", decimal=True),
        Field("subslot", 2, "Interface module slot.", f"{_SUBMODULE}.subslot", decimal=True),
        Field("address_offset", 2, "Offset in the addresses of the module.", f"{_SUBMODULE}.offset", decimal=True),
        Field("expected_maker", 2, "Expected manufacturer or profile.", f"{_SUBMODULE}.solltyp1"),
        Field("expected_device", 2, "Expected device.", f"{_SUBMODULE}.solltyp2"),
        Field("expected_number", 2, "Sequential number or profile index.", f"{_SUBMODULE}.solltyp3", decimal=True),
        Field("expected_module", 4, "Expected module.", f"{_SUBMODULE}.solltyp4_5"),
        Field("expected_submodule", 4, "Expected submodule.", f"{_SUBMODULE}.solltyp6_7"),
        Field("difference", 2, "Whether expected and actual differ.", f"{_SUBMODULE}.expactid"),
        Field("reserved", 2, "Reserved.", f"{_SUBMODULE}.reserve1"),
        *flags(f"{_SUBMODULE}.eastat", "- - - - - - maintenance_demanded=modmaintdem maintenance_required=modmaintreq"
               " local_segment=modlocseg - cir_active=ciractive station_problem=statproblem disabled=moddisabl"
               " not_available=modnotav exists=modexists disrupted=moddisrupt"),
        Field("area", 2, "Area of the module.", f"{_SUBMODULE}.berbgbr.areaid", MODULE_AREAS, (0x0070, 4)),
        Field("width", 2, "Width of the module.", f"{_SUBMODULE}.berbgbr.width", None, (0x0007, 0), True,
              decimal=True),
        reserved("reserved_last", 10, f"{_SUBMODULE}.reserve2"),
    ],
)  # fmt: skip

#: Diagnostic data of a module: data record 0, which is also the beginning of data record 1.
MODULE_DIAGNOSTICS: Final = Layout(
    "module diagnostics",
    _MANUAL,
    [
        *flags("", "wrong_parameters parameters_missing front_connector_missing auxiliary_voltage_missing channel_fault"
               " external_fault internal_fault module_fault"),
        *flags("", "maintenance substitute_interrupt user_information channel_information - - - -"),
        Field("module_class", 1, "Kind of module.", "", DIAGNOSED_MODULES, (0x0F, 0), True),
        # The manual describes both maintenance bits in the same way.
        *flags("", "maintenance_too buffering_failed battery_exhausted internal_supply_failed watchdog stopped"
               " communication_fault user_module_wrong"),
        *flags("", "- hardware_interrupt_lost fuse_blown converter_fault ram_fault eprom_fault processor_failed"
               " expansion_rack_failed"),
    ],
)  # fmt: skip
