"""The parts of S7 bodies that become Scapy classes: one row each, from which `dissect.layers.part_classes` makes the class.

A row names the layout that the class is made of (`dissect.s7`), says what it is, and gives the values of a new packet where
they are not 0. The sections are those of docs/layers-parts.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, NamedTuple

from dissect.layers.part_counts import (
    Counting,
    block_size,
    local_data,
    octets_behind,
    payload_behind,
    records_behind,
    variables_behind,
)
from dissect.s7 import (
    alarm_layouts,
    blocks,
    clock,
    control,
    cyclic,
    diagnostics,
    layouts,
    nc,
    pbc,
    programmer_layouts,
    start_information,
    syntaxes,
    szl,
    szl_communication,
    szl_modules,
    szl_records,
    transfer,
)
from dissect.s7.data_parts import CONTENT, RETURN_CODE
from dissect.s7.tables import SUCCESS
from dissect.wire.layout import Layout
from dissect.wire.part import FILL, OCTETS, SURPLUS


class Row(NamedTuple):
    """A class: its name, its layout, what it is in a sentence or two, and the values of a new packet.

    A default of None is a field that building fills in. ``counted`` names the classes whose parts a field counts;
    ``counting`` is what counts anything else. ``title`` is what Scapy shows, where that is not the layout's name.
    """

    name: str
    layout: Layout
    text: str
    defaults: Mapping[str, Any] = {}
    counted: Mapping[str, tuple[str, ...]] = {}
    counting: Counting | None = None
    title: str = ""


#: What an alarm counts as its objects.
_OBJECTS: Final = (
    "S7_AlarmToLock",
    "S7_AlarmMessage",
    "S7_AlarmAcknowledgement",
    "S7_Notification",
    "S7_AlarmQueryByType",
    "S7_AlarmQueryByEvent",
    "S7_AlarmQueryOther",
    "S7_ReturnCode",
)

SECTIONS: Final[dict[str, list[Row]]] = {
    "Parts of message bodies": [
        Row("S7_Octets", OCTETS, "Bytes whose meaning is not known, or depends on something else than this message."),
        Row("S7_Surplus", SURPLUS, "Bytes where nothing may follow."),
        Row("S7_Fill", FILL, "The byte that makes an odd item even, where it does not belong to an item."),
        Row("S7_Content", CONTENT, "The content of a data item, where it does not belong to an item."),
        Row("S7_ReturnCode", RETURN_CODE, "A return code in place of an item.", {"return_code": SUCCESS}),
        Row("S7_FunctionOnly", layouts.FUNCTION, "The function alone, as most good answers have it.", title="S7 function only"),
    ],
    "Userdata (ROSCTR 7)": [
        Row("S7_DataHead", layouts.DATA_HEAD, "What precedes the payload of userdata. With parts after it: success, bytes, their number; alone: no payload (return code 0x0A).", {"return_code": None, "transport_size": None}, counting=payload_behind),
    ],
    "Messages and alarms": [
        Row("S7_MessageRequest", alarm_layouts.MESSAGE_REQUEST, "Subscription of events: which, and the name of who asks."),
        Row("S7_MessageAnswer", alarm_layouts.MESSAGE_ANSWER, "Answer to a subscription of events.", {"result": 2}),
        Row("S7_AlarmSubscription", alarm_layouts.ALARM_SUBSCRIPTION, "Which alarms, in a request with the bit of alarms and in its answer."),
        Row("S7_MessageReserved", alarm_layouts.MESSAGE_RESERVED, "What ends a subscription of alarms."),
        Row("S7_MessageReservedAnswer", alarm_layouts.MESSAGE_RESERVED_ANSWER, "What ends the answer to a subscription of alarms.", {"reserved_2": 1}),
        Row("S7_Archive", alarm_layouts.ARCHIVE_ITEM, "An archive of AR_SEND by its AR_ID.", {"length": 7, "syntax_id": 0, "specification": 0x12}),
        Row("S7_ArchiveCount", alarm_layouts.ARCHIVE_COUNT, "How many archives follow.", {"item_count": None}, counted={"item_count": ("S7_Archive", "S7_ReturnCode")}),
        Row("S7_ArchiveLength", alarm_layouts.ARCHIVE_LENGTH, "Bytes of an archive, in the first part; the low byte first, unlike everything else."),
        Row("S7_ArchiveData", alarm_layouts.ARCHIVE_DATA, "The content of an archive."),
        Row("S7_AlarmHead", alarm_layouts.ALARM_HEAD, "Time and objects of an alarm, a notification or an acknowledgement.", {"objects": None}, counted={"objects": _OBJECTS}),
        Row("S7_ScanHead", alarm_layouts.SCAN_HEAD, "Head of a push of SCAN.", {"objects": None}, counted={"objects": _OBJECTS}),
        Row("S7_AlarmObjects", alarm_layouts.OBJECTS_HEAD, "Number of objects without a time. Locks, acknowledgements, queries.", {"objects": None}, counted={"objects": _OBJECTS}),
        Row("S7_AlarmToLock", alarm_layouts.SYNTAXES[21], "An alarm to lock or unlock, or locked or unlocked.", {"syntax_id": 0x15, "specification": 0x12}),
        Row("S7_AlarmMessage", alarm_layouts.SYNTAXES[22], "An alarm in an indication.", {"syntax_id": 0x16, "specification": 0x12}),
        Row("S7_AlarmAcknowledgement", alarm_layouts.SYNTAXES[25], "An alarm to acknowledge, or acknowledged.", {"syntax_id": 0x19, "specification": 0x12}),
        Row("S7_Notification", alarm_layouts.SYNTAXES[28], "A notification, with the signals that came and went.", {"syntax_id": 0x1C, "specification": 0x12}),
        Row("S7_AlarmQueryByType", alarm_layouts.QUERY_BY_TYPE, "Requests the pending alarms of a kind.", {"syntax_id": 0x1A, "query_type": 1, "specification": 0x12}),
        Row("S7_AlarmQueryByEvent", alarm_layouts.QUERY_BY_EVENT, "Requests one alarm by its number.", {"syntax_id": 0x1A, "query_type": 3, "specification": 0x12}),
        Row("S7_AlarmQueryOther", alarm_layouts.QUERY_OTHER, "An alarm query of an unknown kind.", {"syntax_id": 0x1A, "specification": 0x12}),
        Row("S7_AlarmQueryAnswer", alarm_layouts.ALARM_QUERY_ANSWER, "Head of the pending alarms that a query is answered with.", {"return_code": 0xFF, "transport_size": 9, "complete_length": None, "objects": 1}, counting=octets_behind),
        Row("S7_AlarmState", alarm_layouts.ALARM_STATE, "A pending alarm. ALARM_S goes on with the two parts after it, each followed by a data item."),
        Row("S7_AlarmSComing", alarm_layouts.ALARM_S_COMING, "When a pending ALARM_S came; a data item follows."),
        Row("S7_AlarmSGoing", alarm_layouts.ALARM_S_GOING, "When a pending ALARM_S went; a data item follows."),
        Row("S7_EndOfAlarms", alarm_layouts.END_OF_ALARMS, "Ends the pending alarms whose length was not given."),
    ],
    "Block functions": [
        Row("S7_BlockCount", blocks.BLOCK_COUNT, "An entry of the answer to list blocks.", {"block_type": b"0A"}),
        Row("S7_BlockTypeWanted", blocks.TYPE_WANTED, "What a request to list the blocks of a type names.", {"block_type": b"0A"}),
        Row("S7_ListedBlock", blocks.LISTED_BLOCK, "An entry of the answer to list blocks of a type."),
        Row("S7_BlockWanted", blocks.BLOCK_WANTED, "What a request of block info names.", {"block_type": b"0A", "block_number": b"00001", "file_system": b"A"}),
        Row("S7_BlockInfo", blocks.INFO, "The answer to block info.", {"constant": 0x0100, "unknown_info": 0x2200, "mark": b"pp", "unknown_mark": 1}),
        Row("S7_BlockHeader", blocks.HEADER, "The header of a block where it is transferred; Wireshark does not look into blocks.", {"mark": b"pp", "unknown_mark": 1}),
    ],
    "Time functions": [
        Row("S7_Clock", clock.CLOCK, "The clock that a read answers with and a set sends. ``time_`` is DATE_AND_TIME, eight bytes in BCD.", {"century": 0x19}),
    ],
    "PI services and PLC stop": [
        Row("S7_PIShort", control.PI_SHORT, "A job without a parameter block and a name.", {"function": 0x28, "unknown": 0xFD}),
        Row("S7_PIHead", control.PI_HEAD, "A PI service: the head, before the parameter block and the name.", {"function": 0x28, "unknown": 0xFD}),
        Row("S7_PIName", control.PI_NAME, "The name of a PI service, after the parameter block.", {"service": b"P_PROGRAM"}),
        Row("S7_PIBlocks", control.PI_BLOCKS, "Parameter block of a PI service about blocks: how many follow."),
        Row("S7_PIBlock", control.PI_BLOCK, "A block that a PI service is about.", {"block_type": b"0A", "block_number": b"00001", "file_system": b"P"}),
        Row("S7_PIArgument", control.PI_ARGUMENT, "Parameter block of other services of the CPU."),
        Row("S7_PIString", control.PI_STRING, "An argument of a Sinumerik service."),
        Row("S7_PIPassword", control.PI_PASSWORD, "A password among the arguments of a Sinumerik service."),
        Row("S7_PIFill", control.PI_FILL, "The byte that makes an argument even; the last one has it too."),
        Row("S7_PLCStop", control.PLC_STOP, "PLC stop with the name of the program.", {"function": 0x29, "service": b"P_PROGRAM"}),
    ],
    "Cyclic services": [
        Row("S7_CyclicRequest", cyclic.CYCLIC_REQUEST, "Head of a request for cyclic or change driven transfer.", {"item_count": None, "time_base": 1, "factor": 1}, counted={"item_count": ("S7_Item",)}),
        Row("S7_CyclicValues", cyclic.CYCLIC_VALUES, "Head of the values in an answer or a push."),
        Row("S7_CyclicUnsubscribe", cyclic.CYCLIC_UNSUBSCRIBE, "Ends a cyclic job.", {"function": 5}),
        Row("S7_RecordHead", cyclic.RECORD_HEAD, "Head of a record request and of its answer; it has no interval.", {"item_count": 1}),
        Row("S7_RecordTransport", cyclic.RECORD_TRANSPORT, "The bytes between the return code and the status of a record that was read.", {"transport_size": 9}),
        Row("S7_RecordStatus", cyclic.RECORD_STATUS, "Status of a data record that was read."),
        Row("S7_RecordNoStatus", cyclic.RECORD_NO_STATUS, "Data record status."),
        Row("S7_RecordLength", cyclic.RECORD_LENGTH, "Bytes of the data record that follows."),
        Row("S7_Record", cyclic.RECORD, "The content of a data record."),
    ],
    "NC programming": [
        Row("S7_NCFile", nc.NC_FILE, "Name of an NC file to download."),
        Row("S7_NCUpload", nc.NC_UPLOAD, "Name of an NC file to upload."),
        Row("S7_NCWindow", nc.NC_WINDOW, "How many PDUs may be or were sent without an acknowledgement."),
        Row("S7_NCPiece", nc.NC_PIECE, "Before a piece of a file, and alone if nothing else is known."),
        Row("S7_NCHeader", nc.NC_HEADER, "A file begins with it."),
        Row("S7_NCPath", nc.NC_PATH, "Path that an NC file begins with."),
        Row("S7_NCData", nc.NC_DATA, "Content of an NC file."),
    ],
    "BSEND and USEND": [
        Row("S7_BSENDLength", pbc.BSEND_LENGTH, "Before the first piece of a BSEND only.", {"total_length": None}, counting=octets_behind),
        Row("S7_BSENDData", pbc.BSEND_DATA, "What a BSEND carries."),
        Row("S7_USENDData", pbc.USEND_DATA, "Before the data items of a USEND.", {"return_code": 0xFF}),
        Row("S7_RId", syntaxes.PBC_ID, "R_ID.", {"length": 6, "syntax_id": 0x13, "specification": 0x12}),
    ],
    "Programmer commands": [
        Row("S7_TestHead", programmer_layouts.TEST_HEAD, "Before the parameter block and the data block of every programmer command.", {"parameter_size": None, "data_size": None}, counting=block_size),
        Row("S7_TestJobSizes", programmer_layouts.JOB_SIZES, "The same within the data block of a job that is read or replaced.", {"parameter_size": None, "data_size": None}, counting=block_size),
        Row("S7_TestRequest", programmer_layouts.TEST_REQUEST, "The parameter block of a request, as far as all have it.", {"trigger_type": 1}),
        Row("S7_TestBlock", programmer_layouts.TEST_BLOCK, "Block and address that a test is about."),
        Row("S7_TestStep", programmer_layouts.TEST_STEP, "Step address counter of a test."),
        Row("S7_TestEnvironment", programmer_layouts.TEST_ENVIRONMENT, "When a test is to work: call environment and condition."),
        Row("S7_TestEnvironmentDBS", programmer_layouts.TEST_ENVIRONMENT_DBS, "Data blocks that are to be open."),
        Row("S7_TestEnvironmentBlock", programmer_layouts.TEST_ENVIRONMENT_BLOCK, "Block that is to call."),
        Row("S7_TestEnvironmentAddress", programmer_layouts.TEST_ENVIRONMENT_ADDRESS, "Address that is to call."),
        Row("S7_TestAnswer", programmer_layouts.TEST_ANSWER, "The parameter block of an answer or push."),
        Row("S7_TestVariables", programmer_layouts.TEST_VARIABLES, "How many variables of a test function follow.", {"item_count": None}, counting=variables_behind),
        Row("S7_TestAddress", programmer_layouts.TEST_ADDRESS, "A variable; the low nibble of the area is the width.", {"area": 0x02, "count": 1}),
        Row("S7_TestBit", programmer_layouts.TEST_BIT, "A variable of one bit: the low nibble of the area is 0."),
        Row("S7_TestJob", programmer_layouts.JOB, "Names a job by the subfunction that made it and the sequence number of its answer."),
        Row("S7_TestJobReserved", programmer_layouts.JOB_RESERVED, "What precedes the job to delete or replace."),
        Row("S7_TestJobListReserved", programmer_layouts.JOB_LIST_RESERVED, "What a request of the job list has."),
        Row("S7_TestJobState", programmer_layouts.JOB_STATE, "An entry of the job list."),
        Row("S7_JobData", programmer_layouts.JOB_DATA, "The data of a job that is read; the answer does not name the kind of job."),
        Row("S7_BlockStatus", programmer_layouts.BLOCK_STATUS, "Registers requested, in block status."),
        Row("S7_BlockStatusLine", programmer_layouts.BLOCK_STATUS_LINE, "A line of a block to watch."),
        Row("S7_BlockStatus2", programmer_layouts.BLOCK_STATUS_2, "The same in block status v2, which knows the lines by their addresses."),
        Row("S7_BlockStatusLine2", programmer_layouts.BLOCK_STATUS_LINE_2, "A line of a block to watch, by its address."),
        Row("S7_BlockStatusStart", programmer_layouts.BLOCK_STATUS_START, "Where the values of a block status begin."),
        Row("S7_BlockStatusData", programmer_layouts.BLOCK_STATUS_DATA, "What the registers held; the request names them and the number of lines."),
        Row("S7_ISTACKRequest", programmer_layouts.ISTACK_REQUEST, "Requests the interrupt stack."),
        Row("S7_ISTACK", programmer_layouts.ISTACK, "The interrupt stack."),
        Row("S7_BSTACKRequest", programmer_layouts.BSTACK_REQUEST, "Requests the block stack."),
        Row("S7_BSTACKEntry", programmer_layouts.BSTACK_ENTRY, "An open block of the block stack."),
        Row("S7_BSTACKClass", programmer_layouts.BSTACK_CLASS, "Follows the entry of an OB."),
        Row("S7_BSTACKTime", programmer_layouts.BSTACK_TIME, "Start time of an OB in the block stack."),
        Row("S7_BSTACKRest", programmer_layouts.BSTACK_REST, "What is left of a start time when the data size is too small by four, as one firmware sends it."),
        Row("S7_LSTACKRequest", programmer_layouts.LSTACK_REQUEST, "Requests the local data stack."),
        Row("S7_LSTACK", programmer_layouts.LSTACK, "The local data stack of a block.", counting=local_data),
        Row("S7_LSTACKData", programmer_layouts.LSTACK_DATA, "Local data of a block."),
        Row("S7_LSTACKClass", programmer_layouts.LSTACK_CLASS, "Priority class and start time after local data."),
        Row("S7_ExitHoldRequest", programmer_layouts.EXIT_HOLD_REQUEST, "Leaves HOLD."),
        Row("S7_BreakpointRequest", programmer_layouts.BREAKPOINT_REQUEST, "Sets a breakpoint."),
        Row("S7_Breakpoint", programmer_layouts.BREAKPOINT, "Where the CPU stopped, and its registers."),
    ],
    "Start information of organisation blocks": [
        Row("S7_StartOther", start_information.OTHER_START, "Of an OB that is not in `START_INFORMATION`."),
        Row("S7_StartOB1", start_information.START_INFORMATION[1], "Start information of OB 1.", title="S7 start information of OB 1"),
        Row("S7_StartOB10", start_information.START_INFORMATION[10], "Start information of OB 10 and those like it.", title="S7 start information of OB 10"),
        Row("S7_StartOB20", start_information.START_INFORMATION[20], "Start information of OB 20 and those like it.", title="S7 start information of OB 20"),
        Row("S7_StartOB30", start_information.START_INFORMATION[30], "Start information of OB 30 and those like it.", title="S7 start information of OB 30"),
        Row("S7_StartOB40", start_information.START_INFORMATION[40], "Start information of OB 40 and those like it.", title="S7 start information of OB 40"),
        Row("S7_StartOB55", start_information.START_INFORMATION[55], "Start information of OB 55 and those like it.", title="S7 start information of OB 55"),
        Row("S7_StartOB80", start_information.START_INFORMATION[80], "Start information of OB 80.", title="S7 start information of OB 80"),
        Row("S7_StartOB81", start_information.START_INFORMATION[81], "Start information of OB 81.", title="S7 start information of OB 81"),
        Row("S7_StartOB82", start_information.START_INFORMATION[82], "Start information of OB 82.", title="S7 start information of OB 82"),
        Row("S7_StartOB83", start_information.START_INFORMATION[83], "Start information of OB 83.", title="S7 start information of OB 83"),
        Row("S7_StartOB84", start_information.START_INFORMATION[84], "Start information of OB 84.", title="S7 start information of OB 84"),
        Row("S7_StartOB85", start_information.START_INFORMATION[85], "Start information of OB 85.", title="S7 start information of OB 85"),
        Row("S7_StartOB86", start_information.START_INFORMATION[86], "Start information of OB 86.", title="S7 start information of OB 86"),
        Row("S7_StartOB87", start_information.START_INFORMATION[87], "Start information of OB 87.", title="S7 start information of OB 87"),
        Row("S7_StartOB90", start_information.START_INFORMATION[90], "Start information of OB 90.", title="S7 start information of OB 90"),
        Row("S7_StartOB100", start_information.START_INFORMATION[100], "Start information of OB 100 and those like it.", title="S7 start information of OB 100"),
        Row("S7_StartOB121", start_information.START_INFORMATION[121], "Start information of OB 121.", title="S7 start information of OB 121"),
        Row("S7_StartOB122", start_information.START_INFORMATION[122], "Start information of OB 122.", title="S7 start information of OB 122"),
    ],
    "Read SZL": [
        Row("S7_SZLRequest", szl.SZL_REQUEST, "Requests a system status list."),
        Row("S7_SZLHead", szl.SZL_HEAD, "Head of a system status list, before its records.", {"record_length": None, "record_count": None}, counting=records_behind),
    ],
    "Records of system status lists": [
        Row("S7_DiagnosticEvent", diagnostics.DIAGNOSTIC_EVENT, "An entry of the diagnostic buffer."),
        Row("S7_SZLRecord", szl_records.RECORD, "A record of a list whose records are not known."),
        Row("S7_SZLRecordRest", szl_records.RECORD_REST, "The rest of a record after the known fields."),
        Row("S7_SZLId", szl_records.SZL_ID, "SZL id of the module."),
        Row("S7_SZLIdentification", szl_records.IDENTIFICATION, "Module identification."),
        Row("S7_SZLCharacteristic", szl_records.CHARACTERISTIC, "CPU characteristic."),
        Row("S7_SZLMemoryArea", szl_records.MEMORY_AREA, "User memory area."),
        Row("S7_SZLSystemArea", szl_records.SYSTEM_AREA, "System area."),
        Row("S7_SZLBlockType", szl_records.BLOCK_TYPE, "Block type."),
        Row("S7_SZLLED", szl_records.LED, "LED."),
        Row("S7_SZLInterruptStatus", szl_records.INTERRUPT_STATUS, "Interrupt status."),
        Row("S7_SZLOperatingMode", szl_records.OPERATING_MODE, "Operating mode."),
        Row("S7_SZLProcessImagePartition", szl_records.PROCESS_IMAGE_PARTITION, "Process image partition."),
        Row("S7_SZLEthernet", szl_records.ETHERNET, "Ethernet interface."),
        Row("S7_SZLHSystem", szl_records.H_SYSTEM, "H system."),
        Row("S7_SZLSystemName", szl_records.COMPONENT_RECORDS[1], "Component: name of the station.", {"index": 1}),
        Row("S7_SZLModuleName", szl_records.COMPONENT_RECORDS[2], "Component: name of the module.", {"index": 2}),
        Row("S7_SZLPlantDesignation", szl_records.COMPONENT_RECORDS[3], "Component: plant designation.", {"index": 3}),
        Row("S7_SZLCopyright", szl_records.COMPONENT_RECORDS[4], "Component: copyright.", {"index": 4}),
        Row("S7_SZLSerialNumber", szl_records.COMPONENT_RECORDS[5], "Component: serial number.", {"index": 5}),
        Row("S7_SZLModuleType", szl_records.COMPONENT_RECORDS[7], "Component: module type.", {"index": 7}),
        Row("S7_SZLMemoryCard", szl_records.COMPONENT_RECORDS[8], "Component: serial number of the memory card.", {"index": 8}),
        Row("S7_SZLManufacturer", szl_records.COMPONENT_RECORDS[9], "Component: manufacturer and profile.", {"index": 9}),
        Row("S7_SZLOem", szl_records.COMPONENT_RECORDS[10], "Component: OEM.", {"index": 10}),
        Row("S7_SZLLocation", szl_records.COMPONENT_RECORDS[11], "Component: location designation.", {"index": 11}),
        Row("S7_SZLComponent", szl_records.COMPONENT, "A component without a meaning that is known."),
    ],
    "Records about modules and stations": [
        Row("S7_SZLSwitchedSlave", szl_modules.SWITCHED_SLAVE, "Switched DP slave."),
        Row("S7_SZLDpMaster", szl_modules.DP_MASTER, "DP master system."),
        Row("S7_SZLDpMasterExtended", szl_modules.DP_MASTER_EXTENDED, "Extended DP master system."),
        Row("S7_SZLModuleStatus", szl_modules.MODULE_STATUS, "Module status."),
        Row("S7_SZLStations", szl_modules.STATIONS, "Rack and station status."),
        Row("S7_SZLManyStations", szl_modules.MANY_STATIONS, "Rack and station status, PROFIBUS DP and PROFINET."),
        Row("S7_SZLSubmoduleStatus", szl_modules.SUBMODULE_STATUS, "Module status, PROFINET IO and PROFIBUS DP."),
    ],
    "Records of the communication lists": [
        Row("S7_SZLCapabilityGeneral", szl_communication.CAPABILITY_RECORDS[1], "Communication unit: general.", {"index": 1}),
        Row("S7_SZLCapabilityTest", szl_communication.CAPABILITY_RECORDS[2], "Communication unit: test and installation.", {"index": 2}),
        Row("S7_SZLCapabilityOperator", szl_communication.CAPABILITY_RECORDS[3], "Communication unit: operator functions.", {"index": 3}),
        Row("S7_SZLCapabilityObjects", szl_communication.CAPABILITY_RECORDS[4], "Communication unit: object management.", {"index": 4}),
        Row("S7_SZLCapabilityDiagnostics", szl_communication.CAPABILITY_RECORDS[5], "Communication unit: diagnostics.", {"index": 5}),
        Row("S7_SZLCapabilityBlocks", szl_communication.CAPABILITY_RECORDS[6], "Communication unit: communication function blocks.", {"index": 6}),
        Row("S7_SZLCapabilityGlobalData", szl_communication.CAPABILITY_RECORDS[7], "Communication unit: global data.", {"index": 7}),
        Row("S7_SZLCapabilityTestTimes", szl_communication.CAPABILITY_RECORDS[8], "Communication unit: times of test and installation.", {"index": 8}),
        Row("S7_SZLCapabilityClock", szl_communication.CAPABILITY_RECORDS[9], "Communication unit: clock.", {"index": 9}),
        Row("S7_SZLCapabilityMessages", szl_communication.CAPABILITY_RECORDS[16], "Communication unit: messages.", {"index": 16}),
        Row("S7_SZLProtection", szl_communication.PROTECTION, "Protection of the CPU: the levels, the switch, what distinguishes versions.", {"index": 4}),
        Row("S7_SZLStatusGeneral", szl_communication.STATUS_RECORDS[1], "Communication section: general.", {"index": 1}),
        Row("S7_SZLStatusTest", szl_communication.STATUS_RECORDS[2], "Communication section: test and installation.", {"index": 2}),
        Row("S7_SZLStatusDiagnostics", szl_communication.STATUS_RECORDS[5], "Communication section: diagnostics.", {"index": 5}),
        Row("S7_SZLStatusBlocks", szl_communication.STATUS_RECORDS[6], "Communication section: data exchange.", {"index": 6}),
        Row("S7_SZLStatusTime", szl_communication.STATUS_RECORDS[8], "Communication section: time system.", {"index": 8}),
        Row("S7_SZLStatusMeters", szl_communication.STATUS_RECORDS[11], "Communication section: run-time meters 0 to 7.", {"index": 11}),
        Row("S7_SZLStatusMeters2", szl_communication.STATUS_RECORDS[12], "Communication section: run-time meters 8 to 15.", {"index": 12}),
    ],
    "Blocks on their way to the PLC and from it": [
        Row("S7_FunctionStatus", transfer.STATUS, "The function and its status: the answer to request download, download block, upload and PI services.", {"function": 0x1B}),
        Row("S7_Download", transfer.DOWNLOAD, "Head of a job to request download or download block.", {"function": 0x1A, "unknown": 0x0100}),
        Row("S7_DownloadEnded", transfer.DOWNLOAD_END, "Head of a job that ends a download.", {"function": 0x1C}),
        Row("S7_Upload", transfer.UPLOAD_HEAD, "Head of a job to start upload or upload, and of the answer to start upload.", {"function": 0x1E}),
        Row("S7_EndUpload", transfer.UPLOAD_END, "Head of a job to end upload.", {"function": 0x1F}),
        Row("S7_FileName", transfer.FILE_NAME, "The name of a block as a file, as devices write it.", {"identifier": b"_", "block_type": b"0A", "block_number": b"00001", "file_system": b"A"}),
        Row("S7_ShortFileName", transfer.SHORT_FILE_NAME, "The same without the first character, as one client writes it.", {"block_type": b"0A", "block_number": b"00001", "file_system": b"A"}),
        Row("S7_PlainFileName", transfer.PLAIN_FILE_NAME, "Any other name; NC files have a path."),
        Row("S7_DownloadLengths", transfer.LENGTHS, "The sizes in a request download.", {"unknown_digit": b"1", "load_length": b"000000", "mc7_length": b"000000"}),
        Row("S7_UploadLength", transfer.UPLOAD_LENGTH, "The size in the answer to start upload."),
        Row("S7_Piece", transfer.PIECE, "Before a piece of a block.", {"unknown": 0x00FB}),
        Row("S7_BlockContent", transfer.CONTENT, "Code, interface and values; a piece may begin and end anywhere."),
    ],
    "Request items of other syntaxes than S7ANY": [
        Row("S7_DBArea", syntaxes.DB_AREA, "An area of a data block in an `S7_DBReadItem`.", {"area_size": 1, "db": 1}),
        Row("S7_SymbolStep", syntaxes.SYMBOL_STEP, "A step on the way to a symbol."),
    ],
}
