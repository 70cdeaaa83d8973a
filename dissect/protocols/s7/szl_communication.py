"""Records of the communication lists: capabilities of a CPU (0x31) and resources in use (0x32); each index has a layout.

Reference section 4.5; positions and names were compared with Wireshark, which uses the names of the Siemens manual.
"""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7.szl_tables import (
    CAPABILITIES,
    NO_YES,
    PROTECTION_LEVELS,
    STARTUP_SWITCH,
    STATUS_SECTIONS,
    SWITCH_POSITIONS,
    TIME_BASES,
)
from dissect.protocols.s7.values import date_and_time
from dissect.wire.codes import CodeTable
from dissect.wire.layout import HOLDS_TIME, Field, Layout, plain

_SECTION: Final = "reference section 4.5"


def flags(wireshark: str, names: str, octets: int = 0, shared: bool = False) -> list[Field]:
    """Return the bits of a field, one `Field` each, highest bit first.

    ``names`` has one word for each bit: ``name``, ``name=last part of Wireshark's name``, or ``-`` for a bit without meaning.
    ``octets`` is the size of the field if not all of its bits have names; ``shared`` is True if other fields come first in the
    same octets.
    """
    words = names.split()
    size = octets or len(words) // 8
    fields: list[Field] = []
    for at, word in enumerate(words):
        if word == "-":
            continue
        bit = len(words) - 1 - at
        name, _, theirs = word.partition("=")
        text = name.replace("_", " ").capitalize() + "."
        known = f"{wireshark}.{theirs or name}" if wireshark else ""
        fields.append(Field(name, size, text, known, None, (1 << bit, bit), shared or bool(fields)))
    return fields


def reserved(name: str, size: int, wireshark: str = "") -> Field:
    """Return a field for reserved octets."""
    return Field(name, size, "Reserved.", wireshark, means=plain)


def _count(name: str, size: int, text: str, wireshark: str) -> Field:
    return Field(name, size, text, wireshark, decimal=True)


def _record(prefix: str, table: CodeTable, index: int, fields: list[Field]) -> Layout:
    head = Field("index", 2, "Which one.", f"{prefix}.index", table)
    return Layout(f"{table.title}: {table.name(index)}", _SECTION, [head, *fields])


#: Communication functions of index 6 and of section 6, one octet each; Wireshark uses the same names in small letters.
_BLOCKS: Final = [
    (0, "put get brcv bsend rcv send urcv usend"),
    (1, "ustatus status resume stop start initiate abort print"),
    (2, "alarm_8p alarm_8 alarm load_me load write read pi"),
    (3, "- - - - - - ar_send notify"),
    (4, ""),
    (5, ""),
    (6, "i_abort i_put i_get x_abort x_put x_get x_rcv x_send"),
    (7, "- control dis_msg en_msg alarm_sc alarm_s alarm_sq scan_snd"),
]


def _blocks(prefix: str, wireshark: str, whole: str) -> list[Field]:
    """Return the eight octets of communication functions; ``whole`` is Wireshark's name of octets without functions."""
    fields: list[Field] = []
    for octet, names in _BLOCKS:
        if not names:
            fields.append(Field(f"{prefix}reserved_{octet}", 1, "Reserved.", f"{whole}_{octet}"))
            continue
        words = [word if word == "-" else f"{prefix}{word}={word}" for word in names.split()]
        fields.extend(flags(f"{wireshark}_{octet}", " ".join(words)))
    for field in fields:
        if field.wireshark.endswith("zugtyp_1.abort"):
            field.wireshark = field.wireshark.replace("_1.abort", "_1abort")  # as Wireshark spells it
    return fields


def _time(name: str, text: str) -> list[Field]:
    """Return the two fields of a time of test functions: time base and value."""
    known = f"s7comm.szl.0131.0008.{name}"
    return [
        Field(f"{name}_base", 2, f"{text}: base.", f"{known}_tb", TIME_BASES, (0xF000, 12)),
        Field(name, 2, f"{text}.", known, None, (0x0FFF, 0), True, decimal=True),
    ]


_GENERAL: Final = "s7comm.szl.0131.0001"
_TEST: Final = "s7comm.szl.0131.0002"
_OPERATOR: Final = "s7comm.szl.0131.0003"
_OBJECTS: Final = "s7comm.szl.0131.0004"
_DIAGNOSTICS: Final = "s7comm.szl.0131.0005"
_SFB: Final = "s7comm.szl.0131.0006"
_GD: Final = "s7comm.szl.0131.0007"
_CLOCK: Final = "s7comm.szl.0131.0009"
_MESSAGES: Final = "s7comm.szl.0131.0010"

#: List 0x31 by index.
CAPABILITY_RECORDS: Final[dict[int, Layout]] = {
    0x01: _record(_GENERAL, CAPABILITIES, 0x01, [
        _count("pdu_length", 2, "Largest PDU.", f"{_GENERAL}.pdu"),
        _count("connections", 2, "Most connections.", f"{_GENERAL}.anz"),
        Field("mpi_bit_rate", 4, "Highest bit rate of the MPI.", f"{_GENERAL}.mpi_bps"),
        Field("bus_bit_rate", 4, "Highest bit rate of the communication bus.", f"{_GENERAL}.kbus_bps"),
        reserved("reserved", 26, f"{_GENERAL}.res"),
    ]),
    0x02: _record(_TEST, CAPABILITIES, 0x02, [
        *flags(f"{_TEST}.funkt_0", "force_selection=force_sel time_measurement=time_meas output_lstack=outp_lstack"
               " output_bstack=outp_bstack output_istack=outp_istack variable_status=var_stat block_status=block_stat -"),
        *flags(f"{_TEST}.funkt_1", "delete_job=del_job enable_job=en_job disable_job=dis_job memory_reset=mem_res"
               " exit_hold breakpoint=breakp force modify_variable=mod_var"),
        *flags(f"{_TEST}.funkt_2", "- flash_led - - block_status_v2=block_stat_v2 replace_job=repl_job"
               " read_job=rd_job read_job_list=rd_job_list"),
        Field("reserved_3", 1, "Reserved.", f"{_TEST}.funkt_3"),
        Field("reserved_4", 1, "Reserved.", f"{_TEST}.funkt_4"),
        Field("reserved_5", 1, "Reserved.", f"{_TEST}.funkt_5"),
        Field("aseg", 6, "System data.", f"{_TEST}.aseg", means=plain),
        Field("eseg", 6, "System data.", f"{_TEST}.eseg", means=plain),
        *flags(f"{_TEST}.trgereig_0", "data_address=data_adr code_address_area=code_adr_a after_code_address=acode_adr"
               " run_to_stop=mtrans_rs cycle_end=sys_cp_mce cycle_start=sys_cp_mcs system_trigger=sys_trig"
               " immediately=immed"),
        *flags(f"{_TEST}.trgereig_1", "- - - before_code_address=bcode_adr range_trigger=range_trig"
               " local_data_area=loc_adr_a local_data=loc_adr data_address_area=data_adr_a"),
        Field("trigger_reserved", 1, "Reserved.", f"{_TEST}.trgereig_2"),
        Field("trgbed", 1, "System data.", f"{_TEST}.trgbed"),
        Field("pfad", 1, "System data.", f"{_TEST}.pfad"),
        Field("tiefe", 1, "System data.", f"{_TEST}.tiefe"),
        Field("systrig", 1, "System data.", f"{_TEST}.systrig"),
        Field("erg_par", 1, "System data.", f"{_TEST}.erg_par"),
        Field("erg_pat_1", 2, "System data.", f"{_TEST}.erg_pat_1"),
        Field("erg_pat_2", 2, "System data.", f"{_TEST}.erg_pat_2"),
        _count("forced", 2, "Most variables that can be modified.", f"{_TEST}.force"),
        Field("time", 2, "System data.", f"{_TEST}.time"),
        Field("reserved", 4, "Reserved.", f"{_TEST}.res"),
    ]),
    0x03: _record(_OPERATOR, CAPABILITIES, 0x03, [
        *flags("s7comm.szl.0131", "- clear_cyclic=0002.funkt_0.clr_cycl_read stop_cyclic=0003.funkt_0.stop_cycl_read"
               " start_cyclic=0003.funkt_0.start_cycl_read cyclic_explicit=0003.funkt_0.init_cycl_read_expl"
               " cyclic_implicit=0003.funkt_0.init_cycl_read_impl write_once=0003.funkt_0.write_once"
               " read_once=0003.funkt_0.read_once"),
        *flags("s7comm.szl.0131", "bit_memory=0002.funkt_1.bit_mem outputs=0002.funkt_1.outputs"
               " inputs=0003.funkt_1.inputs peripherals=0003.funkt_1.periph_io - - - -"),
        *flags("s7comm.szl.0131", "counters=0002.funkt_2.s7_counter - - - - - data_records=0003.funkt_2.data_rec"
               " user_db=0003.funkt_2.user_db"),
        *flags(f"{_OPERATOR}.funkt_3", "- - - - fast_counters=hs_counter iec_timers=iec_timer"
               " iec_counters=iec_counter timers=s7_timer"),
        _count("consistent_size", 2, "Most bytes that are read consistently.", f"{_OPERATOR}.data"),
        _count("cyclic_jobs", 2, "Most cyclic jobs.", f"{_OPERATOR}.anz"),
        _count("shortest_period", 2, "Shortest period, in 100 ms.", f"{_OPERATOR}.per_min"),
        _count("longest_period", 2, "Longest period, in 100 ms.", f"{_OPERATOR}.per_max"),
        reserved("reserved", 26, f"{_OPERATOR}.res"),
    ]),
    0x04: _record(_OBJECTS, CAPABILITIES, 0x04, [
        *flags(f"{_OBJECTS}.funkt_0", "delete_list chain_copied chain_list copy directory_3=dir_h3 directory_2=dir_h2"
               " directory_1=dir_h1 -"),
        *flags(f"{_OBJECTS}.funkt_1", "delete_all - - - - load_when_exchanging=load_w_chg"
               " assign_when_chaining=asgn_w_chain upload=upl_on_pg"),
        *flags(f"{_OBJECTS}.funkt_2", "ram_mode=set_ram_mode firmware_update=fw_update compress save_all save_eprom"
               " save_ram load_eprom load_ram"),
        *flags(f"{_OBJECTS}.funkt_3", "assign_with_card=asgn_par_mc assign_to_new_modules=asgn_par_mod - - - - -"
               " eprom_mode=set_eprom_mode"),
        *flags(f"{_OBJECTS}.funkt_4", "- - firmware_update_by_card=fw_update_mc evaluate_card=ev_mc"
               " compress_by_sfc=compress assign_in_restart=asgn_par_res assign_in_complete_restart=asgn_par_cres"
               " assign_when_loading=asgn_par_lprog"),
        Field("reserved_5", 1, "Reserved.", f"{_OBJECTS}.funkt_5"),
        Field("reserved_6", 1, "Reserved.", f"{_OBJECTS}.funkt_6"),
        Field("reserved_7", 1, "Reserved.", f"{_OBJECTS}.funkt_7"),
        _count("copied", 1, "Most blocks copied.", f"{_OBJECTS}.kop"),
        _count("deleted", 1, "Most blocks deleted without a break.", f"{_OBJECTS}.del"),
        _count("chained", 1, "Most blocks chained in a job.", f"{_OBJECTS}.kett"),
        _count("uploads", 1, "Most uploads at a time.", f"{_OBJECTS}.hoch"),
        _count("moved", 1, "Largest block that is moved in RUN.", f"{_OBJECTS}.ver"),
        reserved("reserved", 25, f"{_OBJECTS}.res"),
    ]),
    0x05: _record(_DIAGNOSTICS, CAPABILITIES, 0x05, [
        *flags(f"{_DIAGNOSTICS}.funkt_0", "- diagnostic_interrupt=diagint evaluates_interrupts=evaldiagint"
               " sends_status=vmdstat sends_user_messages=userdiag sends_system_messages=sysdiag"
               " diagnostic_buffer=diag_buf -"),
        *[Field(f"reserved_{octet}", 1, "Reserved.", f"{_DIAGNOSTICS}.funkt_{octet}") for octet in range(1, 8)],
        _count("sinks", 2, "Most receivers of diagnostic data.", f"{_DIAGNOSTICS}.anz_sen"),
        _count("entries", 2, "Most entries of the diagnostic buffer.", f"{_DIAGNOSTICS}.anz_ein"),
        _count("messages", 2, "Most group messages of process control.", f"{_DIAGNOSTICS}.anz_mel"),
        reserved("reserved", 24, f"{_DIAGNOSTICS}.res"),
    ]),
    0x06: _record(_SFB, CAPABILITIES, 0x06, [
        *_blocks("", f"{_SFB}.funkt", f"{_SFB}.funkt"),
        Field("fast", 1, "Fast reaction.", f"{_SFB}.schnell"),
        *_blocks("permits_", f"{_SFB}.zugtyp", f"{_SFB}.zugtyp"),
        Field("reserved_19", 1, "Reserved.", f"{_SFB}.res1", means=plain),
        _count("parameters", 2, "Most parameters of a block.", f"{_SFB}.max_sd_empf"),
        _count("alarm_parameters", 2, "Most parameters of ALARM_8P.", f"{_SFB}.max_sd_al8p"),
        _count("instances", 2, "Most instances for configured connections.", f"{_SFB}.max_inst"),
        reserved("reserved_26", 2, f"{_SFB}.res2"),
        Field("configured", 1, "1: connections can be configured.", f"{_SFB}.verb_proj"),
        Field("programmed", 1, "1: connections can be programmed.", f"{_SFB}.verb_prog"),
        reserved("reserved", 10, f"{_SFB}.res3"),
    ]),
    0x07: _record(_GD, CAPABILITIES, 0x07, [
        *flags(f"{_GD}.funkt_0", "- - - - - gd_rcv gd_snd cyclic"),
        Field("reserved_1", 1, "Reserved.", f"{_GD}.funkt_1"),
        *flags(f"{_GD}.obj_0", "- - db counters=c timers=t outputs=piq inputs=pii bit_memory=m"),
        Field("reserved_3", 1, "Reserved.", f"{_GD}.obj_1"),
        _count("consistent_size", 1, "Consistent bytes.", f"{_GD}.kons"),
        _count("send_rate", 1, "Smallest scan rate for sending.", f"{_GD}.sen"),
        _count("receive_rate", 1, "Smallest scan rate for receiving.", f"{_GD}.rec"),
        Field("monitoring", 1, "Time monitoring on receiving.", f"{_GD}.time"),
        Field("reconfiguration", 1, "Can be configured anew in RUN.", f"{_GD}.proj"),
        Field("interrupt", 1, "Communication interrupt.", f"{_GD}.alarm"),
        *flags(f"{_GD}.mode", "- - - - - - communication_bus=comm_bus mpi=pl_mpi"),
        _count("circles", 1, "Most GD circles.", f"{_GD}.kreis"),
        _count("sent_of_circle", 1, "Most packets sent of a circle.", f"{_GD}.sk_1"),
        _count("sent", 1, "Most packets sent of all circles.", f"{_GD}.sk_2"),
        _count("received_of_circle", 1, "Most packets received of a circle.", f"{_GD}.ek_1"),
        _count("received", 1, "Most packets received of all circles.", f"{_GD}.ek_2"),
        _count("packet_size", 1, "Longest packet.", f"{_GD}.len_1"),
        _count("packet_head", 1, "Bytes of a packet's head.", f"{_GD}.len_2"),
        _count("object_head", 1, "Bytes of an object's head.", f"{_GD}.len_3"),
        reserved("reserved", 19, f"{_GD}.res"),
    ]),
    0x08: _record("s7comm.szl.0131.0008", CAPABILITIES, 0x08, [
        *_time("last_1", "Base load of block status"),
        *_time("last_2", "Base load of monitoring variables"),
        *_time("last_3", "Base load of modifying variables"),
        *_time("merker", "Per variable in bit memory"),
        *_time("ea", "Per variable in inputs and outputs"),
        *_time("tz", "Per timer or counter"),
        *_time("db", "Per variable in a DB"),
        *_time("ld", "Per variable in local data"),
        *_time("reg", "Per register"),
        *_time("ba_stali1", "Per status list of group 1"),
        *_time("ba_stali2", "Per status list of group 2"),
        *_time("ba_stali3", "Per status list of group 3"),
        *_time("akku", "More for accumulators"),
        *_time("address", "More for address registers"),
        *_time("dbreg", "More for DB registers"),
        reserved("reserved", 8, "s7comm.szl.0131.0008.res"),
    ]),
    0x09: _record(_CLOCK, CAPABILITIES, 0x09, [
        *flags(f"{_CLOCK}.sync_k", "- - - - - bus_master=master bus_slave=slave bus_neutral=neutral"),
        *flags(f"{_CLOCK}.sync_mpi", "- - - - - mpi_master=master mpi_slave=slave mpi_neutral=neutral"),
        *flags(f"{_CLOCK}.sync_mfi", "- - - - - mfi_master=master mfi_slave=slave mfi_neutral=neutral"),
        Field("reserved_3", 1, "Reserved.", f"{_CLOCK}.res1"),
        _count("deviation_buffered", 2, "Deviation in ms a day, buffered.", f"{_CLOCK}.abw_puf"),
        _count("deviation", 2, "Deviation in ms a day, in operation.", f"{_CLOCK}.abw_5v"),
        _count("meters", 2, "Run-time meters.", f"{_CLOCK}.anz_bsz"),
        reserved("reserved", 28, f"{_CLOCK}.res2"),
    ]),
    0x10: _record(_MESSAGES, CAPABILITIES, 0x10, [
        *flags(f"{_MESSAGES}.funk_1", "- - - - sends_archive=send_arc alarms=notify_alarm scan=scan_possible"
               " group_status=grp_status_msg"),
        Field("reserved_1", 1, "Reserved.", f"{_MESSAGES}.funk_2"),
        *flags(f"{_MESSAGES}.ber_meld_1", "- - - - message_db=db message_m=m message_piq=piq message_pii=pii"),
        Field("reserved_3", 1, "Reserved.", f"{_MESSAGES}.ber_meld_2"),
        *flags(f"{_MESSAGES}.ber_zus_1", "- - - - value_db=db value_m=m value_piq=piq value_pii=pii"),
        Field("reserved_5", 1, "Reserved.", f"{_MESSAGES}.ber_zus_2"),
        *flags(f"{_MESSAGES}.typ_zus_1", "- array=array_char counter timer dword word byte bit"),
        Field("reserved_7", 1, "Reserved.", f"{_MESSAGES}.typ_zus_2"),
        _count("archives", 2, "Most archives that are sent.", "s7comm.szl.0132.0010.maxanz_arch"),
        reserved("reserved", 28, f"{_MESSAGES}.res"),
    ]),
}  # fmt: skip

_S_GENERAL: Final = "s7comm.szl.0132.0001"
_S_TEST: Final = "s7comm.szl.0132.0002"
_PROTECTION: Final = "s7comm.szl.0132.0004"
_S_DIAGNOSTICS: Final = "s7comm.szl.0132.0005"
_EXCHANGE: Final = "s7comm.szl.0132.0006"
_TIME: Final = "s7comm.szl.0132.0008"


def _meters(index: int, first: int) -> Layout:
    """Return the record of eight run-time meters (hours)."""
    known = f"s7comm.szl.0132.{index:04x}"
    return _record(known, STATUS_SECTIONS, index, [
        Field("running", 1, "One bit for each meter: it runs.", f"{known}.bszl_0"),
        Field("reserved_1", 1, "Reserved.", f"{known}.bszl_1"),
        Field("overflow", 1, "One bit for each meter: it ran over.", f"{known}.bszu_0"),
        Field("reserved_2", 1, "Reserved.", f"{known}.bszu_1"),
        *[_count(f"meter_{number}", 4, "Hours.", f"{known}.clock{number}") for number in range(first, first + 8)],
        reserved("reserved", 2, f"{known}.res"),
    ])  # fmt: skip


#: Protection of the CPU: levels, switch positions, and checksums for comparing versions.
PROTECTION: Final = _record(_PROTECTION, STATUS_SECTIONS, 0x04, [
    Field("switch_level", 2, "Protection level set with the switch.", f"{_PROTECTION}.key", PROTECTION_LEVELS),
    Field("parameter_level", 2, "Protection level set in the parameters.", f"{_PROTECTION}.param", PROTECTION_LEVELS),
    Field("level", 2, "Protection level that holds.", f"{_PROTECTION}.real", PROTECTION_LEVELS),
    Field("switch", 2, "Position of the mode switch.", f"{_PROTECTION}.bart_sch", SWITCH_POSITIONS),
    Field("startup_switch", 2, "Position of the start-up switch.", f"{_PROTECTION}.crst_wrst", STARTUP_SWITCH),
    Field("fail_safe", 2, "0: no F program.", f"{_PROTECTION}.ken_f"),
    Field("redundancy", 2, "Whether the ids below are valid.", f"{_PROTECTION}.ken_rel"),
    # Without Wireshark's names: it reads these four as little-endian.
    Field("hardware_1", 2, "Checksum 1 of the hardware configuration."),
    Field("hardware_2", 2, "Checksum 2 of the hardware configuration."),
    Field("program_1", 2, "Checksum 1 of the user program."),
    Field("program_2", 2, "Checksum 2 of the user program."),
    reserved("reserved", 16, f"{_PROTECTION}.res"),
])  # fmt: skip

#: List 0x32 by index.
STATUS_RECORDS: Final[dict[int, Layout]] = {
    0x01: _record(_S_GENERAL, STATUS_SECTIONS, 0x01, [
        _count("pg_guaranteed", 2, "Connections kept for programming devices.", f"{_S_GENERAL}.res_pg"),
        _count("os_guaranteed", 2, "Connections kept for operator stations.", f"{_S_GENERAL}.res_os"),
        _count("pg_used", 2, "Connections of programming devices.", f"{_S_GENERAL}.u_pg"),
        _count("os_used", 2, "Connections of operator stations.", f"{_S_GENERAL}.u_os"),
        _count("configured", 2, "Configured connections.", f"{_S_GENERAL}.proj"),
        _count("configured_open", 2, "Configured connections that are open.", f"{_S_GENERAL}.auf"),
        _count("free", 2, "Free connections.", f"{_S_GENERAL}.free"),
        _count("free_used", 2, "Free connections in use.", f"{_S_GENERAL}.used"),
        _count("load", 2, "Largest communication load in percent.", f"{_S_GENERAL}.last"),
        reserved("reserved", 20, f"{_S_GENERAL}.res"),
    ]),
    0x02: _record(_S_TEST, STATUS_SECTIONS, 0x02, [
        _count("jobs", 2, "Test and installation jobs.", f"{_S_TEST}.anz"),
        reserved("reserved", 36, f"{_S_TEST}.res"),
    ]),
    0x04: PROTECTION,
    0x05: _record(_S_DIAGNOSTICS, STATUS_SECTIONS, 0x05, [
        Field("extended", 2, "Extended functions.", f"{_S_DIAGNOSTICS}.erw", NO_YES),
        Field("sending", 2, "Sends of its own accord.", f"{_S_DIAGNOSTICS}.send", NO_YES),
        Field("user_messages", 2, "User messages can be sent now.", f"{_S_DIAGNOSTICS}.moeg", NO_YES),
        Field("status_messages", 2, "Status messages are made.", f"{_S_DIAGNOSTICS}.ltmerz", NO_YES),
        reserved("reserved", 30, f"{_S_DIAGNOSTICS}.res"),
    ]),
    0x06: _record(_EXCHANGE, STATUS_SECTIONS, 0x06, [
        *_blocks("uses_", f"{_SFB}.funkt", f"{_EXCHANGE}.used"),
        _count("reserved_8", 1, "Reserved.", f"{_EXCHANGE}.anz_schnell"),
        _count("instances", 2, "Loaded SFB instances.", f"{_EXCHANGE}.anz_inst"),
        _count("multicast", 2, "Blocks used for multicast.", f"{_EXCHANGE}.anz_multicast"),
        reserved("reserved", 25, f"{_EXCHANGE}.res"),
    ]),
    0x08: _record(_TIME, STATUS_SECTIONS, 0x08, [
        _count("cycle", 2, "Cycle of the synchronisation frames.", f"{_TIME}.zykl"),
        _count("correction", 2, "Correction of the time of day.", f"{_TIME}.korr"),
        *[_count(f"meter_{number}", 2, "Hours.", f"{_TIME}.clock{number}") for number in range(8)],
        Field("time", 8, "Date and time.", f"{_TIME}.time", means=date_and_time, holds=HOLDS_TIME),
        reserved("reserved", 10, f"{_TIME}.res"),
    ]),
    0x0B: _meters(0x0B, 0),
    0x0C: _meters(0x0C, 8),
}  # fmt: skip
