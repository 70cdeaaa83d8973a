"""Records of system status lists: the layout of a record, by partial list and index (reference section 4.5).

Layouts without a reference section come from the Siemens manual of system and standard functions; sizes and positions were
compared with Wireshark for all that it supports. Communication lists are in `dissect.protocols.s7.szl_communication`, lists of
modules and stations in `dissect.protocols.s7.szl_modules`.
"""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7.diagnostic_tables import EVENTS
from dissect.protocols.s7.diagnostics import DIAGNOSTIC_EVENT
from dissect.protocols.s7.szl_communication import flags, reserved
from dissect.protocols.s7.szl_modules import (
    DP_MASTER,
    DP_MASTER_EXTENDED,
    MANY_STATIONS,
    MODULE_DIAGNOSTICS,
    MODULE_STATUS,
    STATIONS,
    SUBMODULE_STATUS,
    SWITCHED_SLAVE,
)
from dissect.protocols.s7.szl_tables import (
    ADDRESS_SOURCES,
    CHARACTERISTICS,
    COMPONENTS,
    IDENTIFICATIONS,
    LED_FLASHING,
    LED_STATES,
    LEDS,
    MEMORY_AREAS,
    MEMORY_KINDS,
    OPERATING_MODES,
    REDUNDANCY,
    STARTUP_KINDS,
    SYSTEM_AREAS,
    SZL_BLOCK_TYPES,
    SZL_IDS,
)
from dissect.protocols.s7.values import date_and_time
from dissect.wire.layout import (
    HOLDS_ADDRESS,
    HOLDS_FLAGS,
    HOLDS_MAC,
    HOLDS_NAME,
    HOLDS_NUMBER,
    HOLDS_PRODUCT,
    HOLDS_SERIAL,
    HOLDS_TIME,
    HOLDS_VALUE,
    REST,
    Field,
    Layout,
    latin,
    plain,
)

_SECTION: Final = "reference section 4.5"
_MANUAL: Final = "Siemens system status list"


def address(octets: bytes) -> str | None:
    """Return an IPv4 address."""
    return ".".join(str(octet) for octet in octets)


def mac_address(octets: bytes) -> str | None:
    """Return an Ethernet address."""
    return octets.hex(":")


#: A record of a list with unknown records.
RECORD: Final = Layout(
    "SZL record",
    _SECTION,
    [Field("octets", REST, "As on the wire.", "s7comm.param.userdata.szl_part_list")],
)
#: The octets of a record after its known fields.
RECORD_REST: Final = Layout("rest of the SZL record", _SECTION, [Field("octets", REST, "As on the wire.")])

SZL_ID: Final = Layout(
    "SZL id of the module", _SECTION, [Field("listed_id", 2, "An id.", "s7comm.szl.0000.0000.szl_id", SZL_IDS)]
)


#: Two blanks, which a device sends in place of a missing number.
BLANK: Final = 0x2020


def version_text(value: int) -> str:
    """Return letter and major version, for example ``V3``; empty if the number is not such a version."""
    letter = chr(value >> 8)
    return f"{letter}{value & 0xFF}" if letter in {"V", "A"} else ""


IDENTIFICATION: Final = Layout(
    "module identification",
    _SECTION,
    [
        Field("index", 2, "What it is about.", "s7comm.szl.xy11.0001.index", IDENTIFICATIONS),
        Field(
            "order_number",
            20,
            "Order number (MLFB), text.",
            "s7comm.szl.xy11.0001.anz",
            means=latin,
            holds=HOLDS_PRODUCT,
        ),
        Field("module_type", 2, "BGTyp.", "s7comm.szl.xy11.0001.bgtyp"),
        Field("version", 2, "Ausbg: version.", "s7comm.szl.xy11.0001.ausbg", says=version_text),
        Field(
            "release",
            2,
            "Ausbe: minor version and patch where the version has a letter; else not of the module.",
            "s7comm.szl.xy11.0001.ausbe",
        ),
    ],
)

CHARACTERISTIC: Final = Layout(
    "CPU characteristic",
    _MANUAL,
    [Field("characteristic", 2, "Something the CPU has.", "s7comm.szl.xy12.0x00.charac", CHARACTERISTICS)],
)

_MEMORY: Final = "s7comm.szl.0013.0000"
MEMORY_AREA: Final = Layout(
    "user memory area",
    _MANUAL,
    [
        Field("index", 2, "Which area.", f"{_MEMORY}.index", MEMORY_AREAS),
        Field("kind", 2, "Kind of memory.", f"{_MEMORY}.code", MEMORY_KINDS),
        Field("memory_size", 4, "Bytes in all.", f"{_MEMORY}.size", decimal=True),
        *flags(f"{_MEMORY}.mode", "- - - - - - - - - - - together=cd_tog separate=cd_sep mixed=mixed_mem"
               " non_volatile=nvol_mem volatile=vol_mem"),
        Field("granularity", 2, "Granularity.", f"{_MEMORY}.granu"),
        Field("volatile_size", 4, "Bytes of the volatile area.", f"{_MEMORY}.ber1", decimal=True),
        Field("volatile_used", 4, "Bytes of it in use.", f"{_MEMORY}.belegt1", decimal=True),
        Field("volatile_block", 4, "Largest free block of it.", f"{_MEMORY}.block1", decimal=True),
        Field("non_volatile_size", 4, "Bytes of the non-volatile area.", f"{_MEMORY}.ber2", decimal=True),
        Field("non_volatile_used", 4, "Bytes of it in use.", f"{_MEMORY}.belegt2", decimal=True),
        Field("non_volatile_block", 4, "Largest free block of it.", f"{_MEMORY}.block2", decimal=True),
    ],
)  # fmt: skip

SYSTEM_AREA: Final = Layout(
    "system area",
    _MANUAL,
    [
        Field("index", 2, "Which area.", "s7comm.szl.xy14.000x.index", SYSTEM_AREAS),
        Field("kind", 2, "Kind of memory.", "s7comm.szl.xy14.000x.code", MEMORY_KINDS),
        Field("quantity", 2, "Elements.", "s7comm.szl.xy14.000x.quantity", decimal=True),
        Field("retentive", 2, "Retentive elements.", "s7comm.szl.xy14.000x.reman", decimal=True),
    ],
)

BLOCK_TYPE: Final = Layout(
    "block type",
    _SECTION,
    [
        Field("index", 2, "Block type.", "s7comm.szl.xy15.000x.index", SZL_BLOCK_TYPES),
        Field("blocks", 2, "Most blocks.", "s7comm.szl.xy15.000x.maxanz", decimal=True),
        Field("total_size", 2, "Most KiB to be loaded.", "s7comm.szl.xy15.000x.maxlng", decimal=True),
        Field("block_size", 4, "Most bytes of a block in work memory.", "s7comm.szl.xy15.000x.maxabl", decimal=True),
    ],
)

_LED: Final = "s7comm.szl.xy74.0000"
LED: Final = Layout(
    "LED",
    _SECTION,
    [
        Field("master", 2, "H CPU: 1 master, 0 standby.", f"{_LED}.cpu_led_id.cputype", None, (0x0800, 11)),
        Field("rack", 2, "H CPU: rack number.", f"{_LED}.cpu_led_id.rackno", None, (0x0700, 8), True),
        Field("led", 2, "Which LED.", f"{_LED}.cpu_led_id.id", LEDS, (0x00FF, 0), True),
        Field("state", 1, "Off or on.", f"{_LED}.led_on", LED_STATES),
        Field("flashing", 1, "Flashing.", f"{_LED}.led_blink", LED_FLASHING),
    ],
)

_STATUS: Final = "s7comm.szl.xy22.00xx"
INTERRUPT_STATUS: Final = Layout(
    "interrupt status",
    _MANUAL,
    [
        Field("start_information", 20, "Start information of the OB.", f"{_STATUS}.info", means=plain, holds=HOLDS_VALUE,),
        *flags(f"{_STATUS}.al1", "- - - - - - - - - entry_locked=eidbl locked_by_test=ioilbt loaded=ioil - active=isia"
               " locked=iel disabled=evpd"),
        *flags(f"{_STATUS}.al2", "- - - - - - - - - - - - discarded=iod stop=gism error=giee lock_source=lis"),
        Field("discarded_by_test", 4, "Discarded by test functions.", f"{_STATUS}.al3"),
    ],
)  # fmt: skip

OPERATING_MODE: Final = Layout(
    "operating mode",
    _SECTION,
    [
        Field("event", 2, "Event that caused the transition.", "s7comm.szl.0424.0000.ereig", EVENTS),
        Field("ae", 1, "Reserved.", "s7comm.szl.0424.0000.ae"),
        Field("previous", 1, "Mode before.", "s7comm.szl.0424.0000.bzu_id.pre", OPERATING_MODES, (0xF0, 4)),
        Field("mode", 1, "Mode requested or reached.", "s7comm.szl.0424.0000.bzu_id.req", OPERATING_MODES, (0x0F, 0),
              True),
        reserved("reserved", 4, "s7comm.szl.0424.0000.res"),
        Field("startup_1", 1, "Start-up information 1.", "s7comm.szl.0424.0000.anlinfo1"),
        Field("startup_2", 1, "Kind of the last start-up.", "s7comm.szl.0424.0000.anlinfo2", STARTUP_KINDS),
        Field("startup_3", 1, "Permitted start-up kinds.", "s7comm.szl.0424.0000.anlinfo3"),
        Field("startup_4", 1, "Last valid operation or setting.", "s7comm.szl.0424.0000.anlinfo4", STARTUP_KINDS),
        Field("time", 8, "When it was.", "s7comm.szl.0424.0000.time", means=date_and_time, holds=HOLDS_TIME),
    ],
)  # fmt: skip

PROCESS_IMAGE_PARTITION: Final = Layout(
    "process image partition",
    _MANUAL,
    [
        Field("partition", 1, "Number of the partition.", decimal=True),
        Field("use", 1, "How it is used."),
        Field("ob", 1, "OB it belongs to.", decimal=True),
        Field("reserved", 1, "0."),
    ],
)

ETHERNET: Final = Layout(
    "Ethernet interface",
    _MANUAL,
    [
        Field("address", 2, "Logical base address."),
        Field("ip_address", 4, "IP address.", means=address, holds=HOLDS_ADDRESS),
        Field("subnet_mask", 4, "Subnet mask.", means=address, holds=HOLDS_NUMBER),
        Field("router", 4, "Default router; the own address if there is none.", means=address, holds=HOLDS_ADDRESS),
        Field("mac_address", 6, "Ethernet address.", means=mac_address, holds=HOLDS_MAC),
        Field("address_source", 1, "Where the IP address comes from.", codes=ADDRESS_SOURCES),
        Field("reserved", 1, "0."),
        Field("dcp_time", 8, "When DCP changed the address last.", means=date_and_time, holds=HOLDS_TIME),
        Field(
            "ports",
            16,
            "Ports 1 to 16: bit 7 valid, 3 auto, 2 link, 1 100 MBd, 0 full duplex.",
            means=plain,
            holds=HOLDS_FLAGS,
        ),
        reserved("reserved_last", 2),
    ],
)

H_SYSTEM: Final = Layout(
    "H system",
    _MANUAL,
    [
        Field("redundancy", 2, "What the system is.", codes=REDUNDANCY),
        Field("master", 1, "Bit 4: CPU in rack 0 is master, bit 5: that in rack 1."),
        Field("link", 1, "Bit 0: link possible; 4, 5: CPU in rack 0, 1; 7: switched over since enabling."),
        Field("control", 2, "SFC 90: bit 0 enabling again, 1 update locked, 2 link-up locked."),
        Field("reserved", 2, "Samfehl."),
        Field("mode_0", 2, "Mode of the CPU in rack 0.", codes=OPERATING_MODES),
        Field("mode_1", 2, "Mode of the CPU in rack 1.", codes=OPERATING_MODES),
        Field("reserved_mode", 2, "Bz_cpu_2."),
        Field("valid", 1, "Bit 0: mode 0 is valid, bit 1: mode 1."),
        Field("synchronisation", 1, "State of the synchronisation."),
    ],
)

_COMPONENT: Final = "s7comm.szl.001c"
#: In an H CPU the first octet has the rack, and whether its CPU is master.
_COMPONENT_HEAD: Final = [Field("index", 2, "Which component.", f"{_COMPONENT}.000x.index", COMPONENTS)]


def _component(index: int, size: int, wireshark: str, holds: str = HOLDS_NAME) -> Layout:
    """Return the layout of a component: a text of ``size`` octets, then reserved octets up to 32."""
    text = Field(
        "text", size, "Text, padded with blanks or zeros.", f"{_COMPONENT}.{wireshark}", means=latin, holds=holds
    )
    rest = [reserved("reserved", 32 - size, f"{_COMPONENT}.000x.res")] if size < 32 else []
    return Layout(f"component: {COMPONENTS.name(index)}", _SECTION, [*_COMPONENT_HEAD, text, *rest])


#: Components by their number.
COMPONENT_RECORDS: Final[dict[int, Layout]] = {
    0x01: _component(0x01, 24, "0001.name"),
    0x02: _component(0x02, 24, "0002.name"),
    0x03: _component(0x03, 32, "0003.tag"),
    0x04: _component(0x04, 26, "0004.copyright"),
    0x05: _component(0x05, 24, "0005.serialn", HOLDS_SERIAL),
    0x07: _component(0x07, 32, "0007.cputypname"),
    0x08: _component(0x08, 32, "0008.snmcmmc", HOLDS_SERIAL),
    0x09: Layout(
        "component: manufacturer and profile",
        _SECTION,
        [
            *_COMPONENT_HEAD,
            Field("manufacturer", 2, "Manufacturer id.", f"{_COMPONENT}.0009.manufacturer_id"),
            Field("profile", 2, "Profile id.", f"{_COMPONENT}.0009.profile_id"),
            Field("profile_type", 2, "Type within the profile.", f"{_COMPONENT}.0009.profile_spec_typ"),
            reserved("reserved", 26, f"{_COMPONENT}.000x.res"),
        ],
    ),
    0x0A: Layout(
        "component: OEM",
        _MANUAL,
        [
            *_COMPONENT_HEAD,
            Field(
                "text",
                26,
                "OEM copyright, text.",
                f"{_COMPONENT}.000a.oem_copyright_string",
                means=latin,
                holds=HOLDS_NAME,
            ),
            Field("oem_id", 2, "OEM id.", f"{_COMPONENT}.000a.oem_id"),
            Field("oem_additional_id", 4, "Further OEM id.", f"{_COMPONENT}.000a.oem_add_id"),
        ],
    ),
    0x0B: _component(0x0B, 32, "000b.loc_id"),
}
#: A component of unknown meaning.
COMPONENT: Final = Layout("component", _SECTION, [*_COMPONENT_HEAD, reserved("reserved", 32, f"{_COMPONENT}.000x.res")])

#: Layouts of records by partial list, for lists whose records all have the same layout.
RECORDS: Final[dict[int, Layout]] = {
    0x00: SZL_ID,
    0x11: IDENTIFICATION,
    0x12: CHARACTERISTIC,
    0x13: MEMORY_AREA,
    0x14: SYSTEM_AREA,
    0x15: BLOCK_TYPE,
    0x19: LED,
    0x22: INTERRUPT_STATUS,
    0x24: OPERATING_MODE,
    0x25: PROCESS_IMAGE_PARTITION,
    0x37: ETHERNET,
    0x71: H_SYSTEM,
    0x74: LED,
    0x75: SWITCHED_SLAVE,
    0x90: DP_MASTER,
    0x91: MODULE_STATUS,
    0x92: STATIONS,
    0x94: MANY_STATIONS,
    0x95: DP_MASTER_EXTENDED,
    0x96: SUBMODULE_STATUS,
    0xA0: DIAGNOSTIC_EVENT,
    0xB1: MODULE_DIAGNOSTICS,
    0xB2: MODULE_DIAGNOSTICS,  # followed by data of the module about its channels
    0xB3: MODULE_DIAGNOSTICS,
}
