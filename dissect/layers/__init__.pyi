# Made by scripts/layers_stub.py from the names of dissect/layers/__init__.py.
# ruff: noqa: F403, F405, I001 - the star stands for the names of another stub; lines are in the order of Python

from dissect.layers.cotp import COTP as COTP
from dissect.layers.cotp import COTP_AK as COTP_AK
from dissect.layers.cotp import COTP_AK_Extended as COTP_AK_Extended
from dissect.layers.cotp import COTP_CC as COTP_CC
from dissect.layers.cotp import COTP_CR as COTP_CR
from dissect.layers.cotp import COTP_DC as COTP_DC
from dissect.layers.cotp import COTP_DR as COTP_DR
from dissect.layers.cotp import COTP_DT as COTP_DT
from dissect.layers.cotp import COTP_DT_Extended as COTP_DT_Extended
from dissect.layers.cotp import COTP_DT_Normal as COTP_DT_Normal
from dissect.layers.cotp import COTP_EA as COTP_EA
from dissect.layers.cotp import COTP_EA_Extended as COTP_EA_Extended
from dissect.layers.cotp import COTP_ED as COTP_ED
from dissect.layers.cotp import COTP_ED_Extended as COTP_ED_Extended
from dissect.layers.cotp import COTP_ED_Normal as COTP_ED_Normal
from dissect.layers.cotp import COTP_ER as COTP_ER
from dissect.layers.cotp import COTP_RJ as COTP_RJ
from dissect.layers.cotp import COTP_RJ_Extended as COTP_RJ_Extended
from dissect.layers.cotp import COTP_Unknown as COTP_Unknown
from dissect.layers.ibh import IBH as IBH
from dissect.layers.ibh import IBH_Rest as IBH_Rest
from dissect.layers.ibh import MPI as MPI
from dissect.layers.ibh import MPI_Long as MPI_Long
from dissect.layers.notation import at as at
from dissect.layers.parameters import COTP_Parameter as COTP_Parameter
from dissect.layers.part_classes import *
from dissect.layers.parts import S7_Part as S7_Part
from dissect.layers.plus_messages import plus_frames as plus_frames
from dissect.layers.plus_messages import plus_message as plus_message
from dissect.layers.plus_messages import plus_parts as plus_parts
from dissect.layers.plus_messages import plus_reply as plus_reply
from dissect.layers.s7 import S7 as S7
from dissect.layers.s7 import S7_Answer as S7_Answer
from dissect.layers.s7 import S7_Body as S7_Body
from dissect.layers.s7 import S7_Data as S7_Data
from dissect.layers.s7 import S7_Function as S7_Function
from dissect.layers.s7 import S7_Job as S7_Job
from dissect.layers.s7 import S7_Setup as S7_Setup
from dissect.layers.s7plus import S7Plus as S7Plus
from dissect.layers.s7plus import S7Plus_Event as S7Plus_Event
from dissect.layers.s7plus import S7Plus_KeepAlive as S7Plus_KeepAlive
from dissect.layers.s7plus import S7Plus_Notification as S7Plus_Notification
from dissect.layers.s7plus import S7Plus_NotificationV1 as S7Plus_NotificationV1
from dissect.layers.s7plus import S7Plus_Request as S7Plus_Request
from dissect.layers.s7plus import S7Plus_Response as S7Plus_Response
from dissect.layers.scd import SCD as SCD
from dissect.layers.scd import bind_scd as bind_scd
from dissect.layers.scd import unbind_scd as unbind_scd
from dissect.layers.session import S7Session as S7Session
from dissect.layers.syntaxes import S7_DBReadItem as S7_DBReadItem
from dissect.layers.syntaxes import S7_DriveItem as S7_DriveItem
from dissect.layers.syntaxes import S7_NCKItem as S7_NCKItem
from dissect.layers.syntaxes import S7_Symbol as S7_Symbol
from dissect.layers.syntaxes import S7_SymbolInDB as S7_SymbolInDB
from dissect.layers.syntaxes import S7_SymbolInMemory as S7_SymbolInMemory
from dissect.layers.tpkt import TPKT as TPKT
from dissect.layers.tpkt import TPKT_Rest as TPKT_Rest
from dissect.layers.tpkt import bind_port as bind_port
from dissect.layers.userdata import S7_ModeTransition as S7_ModeTransition
from dissect.layers.userdata import S7_Password as S7_Password
from dissect.layers.userdata import S7_USEND as S7_USEND
from dissect.layers.userdata import S7_Userdata as S7_Userdata
from dissect.layers.userdata import S7_UserdataExtended as S7_UserdataExtended
from dissect.layers.userdata import S7_UserdataShort as S7_UserdataShort
from dissect.layers.variables import S7_Any as S7_Any
from dissect.layers.variables import S7_DataItem as S7_DataItem
from dissect.layers.variables import S7_Item as S7_Item
from dissect.layers.variables import S7_OtherItem as S7_OtherItem
from dissect.layers.variables import S7_ReadVarAnswer as S7_ReadVarAnswer
from dissect.layers.variables import S7_ReadVarRequest as S7_ReadVarRequest
from dissect.layers.variables import S7_WriteDataItem as S7_WriteDataItem
from dissect.layers.variables import S7_WriteVarAnswer as S7_WriteVarAnswer
from dissect.layers.variables import S7_WriteVarRequest as S7_WriteVarRequest

__all__ = [  # noqa: RUF022  # as Python sorts them
    "COTP",
    "COTP_AK",
    "COTP_AK_Extended",
    "COTP_CC",
    "COTP_CR",
    "COTP_DC",
    "COTP_DR",
    "COTP_DT",
    "COTP_DT_Extended",
    "COTP_DT_Normal",
    "COTP_EA",
    "COTP_EA_Extended",
    "COTP_ED",
    "COTP_ED_Extended",
    "COTP_ED_Normal",
    "COTP_ER",
    "COTP_Parameter",
    "COTP_RJ",
    "COTP_RJ_Extended",
    "COTP_Unknown",
    "IBH",
    "IBH_Rest",
    "MPI",
    "MPI_Long",
    "S7",
    "S7Plus",
    "S7Plus_Address",
    "S7Plus_Attribute",
    "S7Plus_AttributeId",
    "S7Plus_Block",
    "S7Plus_Count",
    "S7Plus_CountByte",
    "S7Plus_Digest",
    "S7Plus_Event",
    "S7Plus_ExploreFilter",
    "S7Plus_ExploreGroup",
    "S7Plus_ExploreHead",
    "S7Plus_Fill",
    "S7Plus_HeldObject",
    "S7Plus_IntegrityId",
    "S7Plus_InvokeHead",
    "S7Plus_ItemCounts",
    "S7Plus_ItemError",
    "S7Plus_ItemValue",
    "S7Plus_KeepAlive",
    "S7Plus_LinkRequest",
    "S7Plus_ListEnd",
    "S7Plus_ListId",
    "S7Plus_Member",
    "S7Plus_Name",
    "S7Plus_NameList",
    "S7Plus_Notification",
    "S7Plus_NotificationHead",
    "S7Plus_NotificationHeadShort",
    "S7Plus_NotificationHeadTimed",
    "S7Plus_NotificationV1",
    "S7Plus_NotifiedObjects",
    "S7Plus_NotifiedPlain",
    "S7Plus_NotifiedRefusal",
    "S7Plus_NotifiedValue",
    "S7Plus_NotifiedValueVlq",
    "S7Plus_Object",
    "S7Plus_ObjectEnd",
    "S7Plus_ObjectId",
    "S7Plus_ObjectIdVlq",
    "S7Plus_Packed",
    "S7Plus_PackedTwice",
    "S7Plus_Piece",
    "S7Plus_Qualifier",
    "S7Plus_Relation",
    "S7Plus_Request",
    "S7Plus_Reserved",
    "S7Plus_Response",
    "S7Plus_ReturnValue",
    "S7Plus_Row",
    "S7Plus_SecondPart",
    "S7Plus_SequenceKind",
    "S7Plus_SequenceType",
    "S7Plus_Tag",
    "S7Plus_TagDescription",
    "S7Plus_TagDescriptionEnd",
    "S7Plus_Value",
    "S7Plus_Variable",
    "S7Plus_VariableList",
    "S7Session",
    "S7_AlarmAcknowledgement",
    "S7_AlarmHead",
    "S7_AlarmMessage",
    "S7_AlarmObjects",
    "S7_AlarmQueryAnswer",
    "S7_AlarmQueryByEvent",
    "S7_AlarmQueryByType",
    "S7_AlarmQueryOther",
    "S7_AlarmSComing",
    "S7_AlarmSGoing",
    "S7_AlarmState",
    "S7_AlarmSubscription",
    "S7_AlarmToLock",
    "S7_Answer",
    "S7_Any",
    "S7_Archive",
    "S7_ArchiveCount",
    "S7_ArchiveData",
    "S7_ArchiveLength",
    "S7_BSENDData",
    "S7_BSENDLength",
    "S7_BSTACKClass",
    "S7_BSTACKEntry",
    "S7_BSTACKRequest",
    "S7_BSTACKRest",
    "S7_BSTACKTime",
    "S7_BlockContent",
    "S7_BlockCount",
    "S7_BlockHeader",
    "S7_BlockInfo",
    "S7_BlockStatus",
    "S7_BlockStatus2",
    "S7_BlockStatusData",
    "S7_BlockStatusLine",
    "S7_BlockStatusLine2",
    "S7_BlockStatusStart",
    "S7_BlockTypeWanted",
    "S7_BlockWanted",
    "S7_Body",
    "S7_Breakpoint",
    "S7_BreakpointRequest",
    "S7_Clock",
    "S7_Content",
    "S7_CyclicRequest",
    "S7_CyclicUnsubscribe",
    "S7_CyclicValues",
    "S7_DBArea",
    "S7_DBReadItem",
    "S7_Data",
    "S7_DataHead",
    "S7_DataItem",
    "S7_DiagnosticEvent",
    "S7_Download",
    "S7_DownloadEnded",
    "S7_DownloadLengths",
    "S7_DriveItem",
    "S7_EndOfAlarms",
    "S7_EndUpload",
    "S7_ExitHoldRequest",
    "S7_FileName",
    "S7_Fill",
    "S7_Function",
    "S7_FunctionOnly",
    "S7_FunctionStatus",
    "S7_ISTACK",
    "S7_ISTACKRequest",
    "S7_Item",
    "S7_Job",
    "S7_JobData",
    "S7_LSTACK",
    "S7_LSTACKClass",
    "S7_LSTACKData",
    "S7_LSTACKRequest",
    "S7_ListedBlock",
    "S7_MessageAnswer",
    "S7_MessageRequest",
    "S7_MessageReserved",
    "S7_MessageReservedAnswer",
    "S7_ModeTransition",
    "S7_NCData",
    "S7_NCFile",
    "S7_NCHeader",
    "S7_NCKItem",
    "S7_NCPath",
    "S7_NCPiece",
    "S7_NCUpload",
    "S7_NCWindow",
    "S7_Notification",
    "S7_Octets",
    "S7_OtherItem",
    "S7_PIArgument",
    "S7_PIBlock",
    "S7_PIBlocks",
    "S7_PIFill",
    "S7_PIHead",
    "S7_PIName",
    "S7_PIPassword",
    "S7_PIShort",
    "S7_PIString",
    "S7_PLCStop",
    "S7_Part",
    "S7_Password",
    "S7_Piece",
    "S7_PlainFileName",
    "S7_RId",
    "S7_ReadVarAnswer",
    "S7_ReadVarRequest",
    "S7_Record",
    "S7_RecordHead",
    "S7_RecordLength",
    "S7_RecordNoStatus",
    "S7_RecordStatus",
    "S7_RecordTransport",
    "S7_ReturnCode",
    "S7_SZLBlockType",
    "S7_SZLCapabilityBlocks",
    "S7_SZLCapabilityClock",
    "S7_SZLCapabilityDiagnostics",
    "S7_SZLCapabilityGeneral",
    "S7_SZLCapabilityGlobalData",
    "S7_SZLCapabilityMessages",
    "S7_SZLCapabilityObjects",
    "S7_SZLCapabilityOperator",
    "S7_SZLCapabilityTest",
    "S7_SZLCapabilityTestTimes",
    "S7_SZLCharacteristic",
    "S7_SZLComponent",
    "S7_SZLCopyright",
    "S7_SZLDpMaster",
    "S7_SZLDpMasterExtended",
    "S7_SZLEthernet",
    "S7_SZLHSystem",
    "S7_SZLHead",
    "S7_SZLId",
    "S7_SZLIdentification",
    "S7_SZLInterruptStatus",
    "S7_SZLLED",
    "S7_SZLLocation",
    "S7_SZLManufacturer",
    "S7_SZLManyStations",
    "S7_SZLMemoryArea",
    "S7_SZLMemoryCard",
    "S7_SZLModuleDiagnostics",
    "S7_SZLModuleName",
    "S7_SZLModuleStatus",
    "S7_SZLModuleType",
    "S7_SZLOem",
    "S7_SZLOperatingMode",
    "S7_SZLPlantDesignation",
    "S7_SZLProcessImagePartition",
    "S7_SZLProtection",
    "S7_SZLRecord",
    "S7_SZLRecordRest",
    "S7_SZLRequest",
    "S7_SZLSerialNumber",
    "S7_SZLStations",
    "S7_SZLStatusBlocks",
    "S7_SZLStatusDiagnostics",
    "S7_SZLStatusGeneral",
    "S7_SZLStatusMeters",
    "S7_SZLStatusMeters2",
    "S7_SZLStatusTest",
    "S7_SZLStatusTime",
    "S7_SZLSubmoduleStatus",
    "S7_SZLSwitchedSlave",
    "S7_SZLSystemArea",
    "S7_SZLSystemName",
    "S7_ScanHead",
    "S7_Setup",
    "S7_ShortFileName",
    "S7_StartOB1",
    "S7_StartOB10",
    "S7_StartOB100",
    "S7_StartOB121",
    "S7_StartOB122",
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
    "S7_StartOther",
    "S7_Surplus",
    "S7_Symbol",
    "S7_SymbolInDB",
    "S7_SymbolInMemory",
    "S7_SymbolStep",
    "S7_TestAddress",
    "S7_TestAnswer",
    "S7_TestBit",
    "S7_TestBlock",
    "S7_TestEnvironment",
    "S7_TestEnvironmentAddress",
    "S7_TestEnvironmentBlock",
    "S7_TestEnvironmentDBS",
    "S7_TestHead",
    "S7_TestJob",
    "S7_TestJobListReserved",
    "S7_TestJobReserved",
    "S7_TestJobSizes",
    "S7_TestJobState",
    "S7_TestRequest",
    "S7_TestStep",
    "S7_TestVariables",
    "S7_USEND",
    "S7_USENDData",
    "S7_Upload",
    "S7_UploadLength",
    "S7_Userdata",
    "S7_UserdataExtended",
    "S7_UserdataShort",
    "S7_WriteDataItem",
    "S7_WriteVarAnswer",
    "S7_WriteVarRequest",
    "SCD",
    "TPKT",
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
