"""The 16-bit error codes of S7comm: header class and code, userdata error code, block-transfer error code.

One table is used for all three (reference section 3.2). The upper octet of a header error is its class. The meaning of a code
depends on the refused function: `errors_of` returns the right table. All code that shows or judges an error uses it, so all
outputs agree.
"""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7.tables import (
    CPU_SERVICES,
    DOWNLOAD_BLOCK,
    DOWNLOAD_ENDED,
    END_UPLOAD,
    PI_SERVICE,
    READ_VAR,
    REQUEST_DOWNLOAD,
    START_UPLOAD,
    UPLOAD,
    WRITE_VAR,
)
from dissect.wire.codes import Code, CodeTable

_ROWS: Final[list[tuple[int, str, str]]] = [
    (0x0000, "No error", "Request carried out"),
    (0x0110, "Invalid block number", "The block number is outside the range the module allows"),
    (0x0111, "Invalid request length", "Length of the request does not fit the service"),
    (0x0112, "Invalid parameter", "A parameter value is not acceptable"),
    (0x0113, "Invalid block type", "The block type code is not known"),
    (0x0114, "Block not found", "No such block on the module"),
    (0x0115, "Block already exists", "A block with this type and number is already there"),
    (0x0116, "Block write-protected", "The block may not be overwritten"),
    (0x0117, "Block or OS update too large", "The object does not fit"),
    (0x0118, "Invalid block number", "The block number is not acceptable (second code for the same fault)"),
    (0x0119, "Incorrect password", "Password check failed"),
    (0x011a, "PG resource error", "The programming device ran out of a resource"),
    (0x011b, "PLC resource error", "The PLC ran out of a resource"),
    (0x011c, "Protocol error", "Message sequence or format violated the protocol"),
    (0x011d, "Too many blocks", "Module-specific limit of blocks exceeded"),
    (0x011e, "No database connection or invalid S7DOS handle", "Local engineering software fault"),
    (0x011f, "Result buffer too small", "Answer does not fit the buffer offered"),
    (0x0120, "End of block list", "No further entry in the list"),
    (0x0140, "Insufficient memory", "Not enough memory for the request"),
    (0x0141, "Lack of resources", "Job not processed because resources are missing"),
    (0x8000, "Function already occupied", "The function is already in use by someone else"),
    (0x8001, "Not possible in current status", "Service not allowed in the present state of the block (libnodave: of the CPU)"),
    (0x8003, "Error during block transfer", "Protocol error while a block was being moved"),
    (0x8100, "Service unknown to partner", "General application error: the remote module does not know the service"),
    (0x8101, "Hardware fault", "The addressed hardware failed (error-class form of item code 0x01)"),
    (0x8103, "Object access not allowed", "Access refused (error-class form of item code 0x03)"),
    (0x8104, "Service not implemented or frame error", "Function unknown to the module, or the frame was wrong; Snap7 calls it function not available"),
    (0x8105, "Invalid address", "Address outside the area (error-class form of item code 0x05)"),
    (0x8106, "Data type not supported", "Transport size not supported (error-class form of item code 0x06)"),
    (0x8107, "Data type inconsistent", "Length and type do not agree (error-class form of item code 0x07)"),
    (0x810a, "Object does not exist", "Addressed object is missing (error-class form of item code 0x0a)"),
    (0x8204, "Inconsistent object type", "Type given for the object contradicts itself"),
    (0x8205, "Copied block exists, not linked", "A passive copy already exists that is not chained in"),
    (0x8301, "Insufficient memory on module", "Load or work memory too small, or the storage medium cannot be reached"),
    (0x8302, "Too few resources", "Resources or processor capacity not available"),
    (0x8304, "No further parallel upload", "Limit of simultaneous uploads reached"),
    (0x8305, "Function not available", "Function cannot be used at present"),
    (0x8306, "Insufficient work memory", "Not enough work memory to copy, link or load"),
    (0x8307, "Insufficient retentive memory", "Not enough retentive work memory to copy, link or load"),
    (0x8401, "Invalid service sequence", "Steps of a load or upload came in the wrong order"),
    (0x8402, "Not possible in object state", "State of the addressed object forbids the service (libnodave: CPU already in RUN or STOP)"),
    (0x8404, "Function cannot be performed", "The partner could not carry out the function"),
    (0x8405, "Remote block disabled", "Partner communication block is in DISABLE state"),
    (0x8500, "Wrong PDU size or frame", "Frame length or PDU size wrong; Snap7: data larger than the PDU"),
    (0x8503, "Service canceled by module", "The module broke the service off early"),
    (0x8701, "Addressing error on partner", "Object cannot be addressed, for example area length exceeded"),
    (0x8702, "Service not supported by module", "Module does not support the service (libnodave: address invalid)"),
    (0x8703, "Access to object refused", "No permission for the object"),
    (0x8704, "Object damaged", "The object cannot be accessed because it is damaged"),
    (0xd001, "Illegal job number", "Test function: job number wrong"),
    (0xd002, "Illegal job variant", "Test function: variant of the job not allowed"),
    (0xd003, "Debug function not supported", "Module has no such test function"),
    (0xd004, "Illegal job status", "Test function: status value not allowed"),
    (0xd005, "Illegal job termination", "Test function: end condition not allowed"),
    (0xd006, "Illegal disconnection id", "Test function: id for link disconnection wrong"),
    (0xd007, "Illegal number of buffer elements", "Test function: buffer count wrong"),
    (0xd008, "Illegal scan rate", "Test function: sampling rate wrong"),
    (0xd009, "Illegal number of executions", "Test function: repetition count wrong"),
    (0xd00a, "Illegal trigger event", "Test function: trigger event not allowed"),
    (0xd00b, "Illegal trigger condition", "Test function: trigger condition not allowed"),
    (0xd011, "Block in call path missing", "Call environment names a block that does not exist"),
    (0xd012, "Wrong address in block", "Code address not valid in the block"),
    (0xd014, "Block being deleted or overwritten", "The block is just being changed"),
    (0xd015, "Illegal tag address", "Variable address not allowed in a parameter"),
    (0xd016, "Test jobs not possible", "Errors in the user program prevent test jobs"),
    (0xd017, "Illegal trigger number", "Trigger number not allowed"),
    (0xd025, "Invalid path", "Call path not valid"),
    (0xd026, "Illegal access type", "Access type not allowed"),
    (0xd027, "Number of data blocks not permitted", "Too many or too few data blocks named"),
    (0xd031, "Internal protocol error", "Fault inside the protocol handling"),
    (0xd032, "Wrong result buffer length", "Result buffer length in the parameter is wrong"),
    (0xd033, "Wrong job length", "Length of the job is wrong"),
    (0xd03f, "Coding error in parameters", "Parameter part wrongly coded, for example reserve bytes not zero"),
    (0xd041, "Illegal status list id", "SZL id in the data is not allowed"),
    (0xd042, "Illegal tag address", "Variable address in the data is not allowed"),
    (0xd043, "Referenced job not found", "Job named in the data does not exist"),
    (0xd044, "Illegal tag value", "Variable value in the data is not allowed"),
    (0xd045, "Exit not allowed in HOLD", "Output-disable control may not be left in HOLD"),
    (0xd046, "Illegal measuring stage", "Run-time measurement: wrong stage"),
    (0xd047, "Illegal hierarchy in read job list", "Hierarchy level not allowed"),
    (0xd048, "Illegal deletion id", "Id in a delete job is wrong"),
    (0xd049, "Invalid substitute id", "Id in a replace job is wrong"),
    (0xd04a, "Program status failed", "Error while executing program status"),
    (0xd05f, "Coding error in data", "Data part wrongly coded, for example reserve bytes not zero"),
    (0xd061, "No memory for job", "Test function: job memory exhausted"),
    (0xd062, "Job list full", "Test function: no further job can be entered"),
    (0xd063, "Trigger event occupied", "Trigger already used by another job"),
    (0xd064, "No memory for one result element", "Not enough memory for one result buffer element"),
    (0xd065, "No memory for result elements", "Not enough memory for several result buffer elements"),
    (0xd066, "Measurement timer occupied", "Run-time measurement timer used by another job"),
    (0xd067, "Too many modify tag jobs", "Limit of active modify jobs reached"),
    (0xd081, "Not permitted in current mode", "Operating mode forbids the function"),
    (0xd082, "Cannot exit HOLD", "HOLD mode cannot be left"),
    (0xd0a1, "Not permitted in current protection level", "Protection level of the CPU forbids the function"),
    (0xd0a2, "Memory-changing function running", "Blocked because another function changes memory"),
    (0xd0a3, "Too many modify tag jobs on I/O", "Limit of modify jobs on the peripherals reached"),
    (0xd0a4, "Force already active", "A force job exists already"),
    (0xd0a5, "Referenced job not found", "The job named does not exist"),
    (0xd0a6, "Job cannot be enabled or disabled", "State of the job forbids it"),
    (0xd0a7, "Job cannot be deleted", "For example because it is being read"),
    (0xd0a8, "Job cannot be replaced", "For example because it is being read or deleted"),
    (0xd0a9, "Job cannot be read", "For example because it is being deleted"),
    (0xd0aa, "Time limit exceeded", "Processing operation took too long"),
    (0xd0ab, "Invalid job parameters", "Parameters wrong in process operation"),
    (0xd0ac, "Invalid job data", "Data wrong in process operation"),
    (0xd0ad, "Operating mode already set", "The requested mode is already active"),
    (0xd0ae, "Job belongs to another connection", "Only the connection that set the job up may handle it"),
    (0xd0c1, "Tag access error", "At least one variable could not be accessed"),
    (0xd0c2, "Change to STOP or HOLD", "The CPU changed its mode"),
    (0xd0c3, "Tag access error and change to STOP or HOLD", "Both happened"),
    (0xd0c4, "Measurement timeout", "Run-time measurement did not end in time"),
    (0xd0c5, "Block stack inconsistent", "Blocks were deleted or reloaded meanwhile"),
    (0xd0c6, "Job deleted with its references", "Removed because the jobs it refers to were deleted"),
    (0xd0c7, "Job deleted on leaving STOP", "Removed because STOP mode ended"),
    (0xd0c8, "Block status aborted", "Test job and running program do not match"),
    (0xd0c9, "Status area left by resetting OB90", "Status ended by OB90 reset"),
    (0xd0ca, "Status area left, access error before", "OB90 reset and a variable access error before it"),
    (0xd0cb, "Output disable active again", "Peripheral output disable was switched on again"),
    (0xd0cc, "Debug data limited by time", "Time limit restricts the amount of test data"),
    (0xd201, "Block name syntax error", "Block name cannot be parsed"),
    (0xd202, "Function parameter syntax error", "Parameters of the function cannot be parsed"),
    (0xd203, "Block type syntax error", "Block type cannot be parsed"),
    (0xd204, "No linked block in storage medium", "Nothing chained in on the medium"),
    (0xd205, "Linked block exists in RAM", "Object already exists; conditional copy not possible"),
    (0xd206, "Linked block exists in EPROM", "Object already exists; conditional copy not possible"),
    (0xd207, "Block exists in EPROM", "Object is in the EPROM"),
    (0xd208, "Too many copied blocks", "Limit of not linked copies exceeded"),
    (0xd209, "Block not found", "At least one block named does not exist on the module"),
    (0xd20a, "Too many blocks to link", "Limit of blocks per link job exceeded"),
    (0xd20b, "Too many blocks to delete", "Limit of blocks per delete job exceeded"),
    (0xd20c, "OB priority class missing", "OB cannot be copied, its priority class does not exist"),
    (0xd20d, "SDB cannot be interpreted", "For example unknown SDB number"),
    (0xd20e, "No further block", "No (more) block available"),
    (0xd20f, "Block too large", "Module-specific block size limit exceeded"),
    (0xd210, "Invalid block number", "Block number not valid or too large"),
    (0xd212, "Incorrect header attribute", "Run-time relevant header attribute wrong"),
    (0xd213, "Too many SDBs", "Module limit of SDBs exceeded"),
    (0xd216, "Invalid user program", "Module must be reset"),
    (0xd217, "Protection level not permitted", "Level named in the module properties is not allowed"),
    (0xd218, "Incorrect active/passive attribute", "Attribute does not fit"),
    (0xd219, "Incorrect block lengths", "Length of the first section or of the whole block wrong"),
    (0xd21a, "Incorrect local data length", "Local data length or write-protection code wrong"),
    (0xd21b, "Cannot compress", "Compression impossible or broken off"),
    (0xd21d, "Illegal dynamic project data volume", "Amount of dynamic project data not allowed"),
    (0xd21e, "Module parameters not assigned", "A module (FM, CP) could not be parameterised; system data not linked"),
    (0xd220, "Invalid programming language", "Language not allowed on this module"),
    (0xd221, "Invalid connection or routing data", "System data for connections or routing not valid"),
    (0xd222, "Invalid global data parameters", "System data of global data communication wrong"),
    (0xd223, "Instance DB error", "Fault in an instance DB of a communication block, or too many of them"),
    (0xd224, "Invalid SCAN system data", "SCAN system data block wrong"),
    (0xd225, "Invalid DP system data", "DP system data block wrong"),
    (0xd226, "Structural error in block", "Block structure damaged"),
    (0xd230, "Structural error in block", "Block structure damaged (second code)"),
    (0xd231, "Loaded OB priority class missing", "At least one loaded OB cannot be copied"),
    (0xd232, "Illegal number of loaded block", "At least one loaded block has a number not allowed"),
    (0xd234, "Block exists twice", "Duplicate in the memory medium or in the job"),
    (0xd235, "Block checksum wrong", "Checksum does not match"),
    (0xd236, "Block without checksum", "Checksum missing"),
    (0xd237, "Block about to be loaded twice", "A block with the same time stamp is already on the CPU"),
    (0xd238, "Block is not a DB", "At least one block named is not a data block"),
    (0xd239, "DB not linked in load memory", "At least one DB has no linked variant"),
    (0xd23a, "DB differs from linked variant", "At least one DB is considerably different"),
    (0xd240, "Coordination rules violated", "Two functions tried to change the same object"),
    (0xd241, "Not permitted in current protection level", "Password needed"),
    (0xd242, "Protection violation with F-blocks", "Fail-safe blocks need a password"),
    (0xd250, "Update does not match module", "Update and module id or version differ"),
    (0xd251, "Wrong sequence of OS components", "Order of the operating system parts is wrong"),
    (0xd252, "Checksum error", "Update checksum wrong"),
    (0xd253, "No loader, card needed", "No executable loader; update only with a memory card"),
    (0xd254, "Storage error in operating system", "Fault while storing"),
    (0xd280, "Block compile error", "Block could not be compiled in an S7-300 CPU"),
    (0xd2a1, "Other block function or trigger active", "Something else is working on a block"),
    (0xd2a2, "Trigger active on block", "Finish the debugging first"),
    (0xd2a3, "Block not active", "Not linked, occupied or marked for deletion"),
    (0xd2a4, "Block already processed", "Another block function is working on it"),
    (0xd2a6, "Save and change at once", "Saving and changing the user program together is not possible"),
    (0xd2a7, "Block unlinked", "Attribute unlinked, or block not processed"),
    (0xd2a8, "Debug function prevents parameter assignment", "A running debug function blocks it"),
    (0xd2a9, "CPU parameters being assigned", "New CPU parameters are just being assigned"),
    (0xd2aa, "Module parameters being assigned", "New module parameters are just being assigned"),
    (0xd2ab, "Configuration limits changing", "Dynamic limits are just being changed"),
    (0xd2ac, "SFC 12 prevents reconfiguration", "A running activate or deactivate job blocks it for now"),
    (0xd2b0, "CiR error", "Error while configuring in RUN"),
    (0xd2c0, "Too many technology objects", "Limit exceeded"),
    (0xd2c1, "Technology DB exists", "The same technology data block is already there"),
    (0xd2c2, "Download not possible", "User program or hardware configuration cannot be loaded"),
    (0xd401, "Invalid SZL id", "Information function not available for this id (libnodave: invalid SZL id)"),
    (0xd402, "Invalid SZL index", "Information function not available for this index (libnodave: invalid SZL index)"),
    (0xd403, "Service already logged on or off", "Diagnostics or process monitoring state unchanged"),
    (0xd404, "Maximum number of nodes reached", "No further logon for diagnostics"),
    (0xd405, "Service not supported or syntax error", "Function parameters wrong or service missing"),
    (0xd406, "Information not available now", "Required diagnostic information is not available at present"),
    (0xd407, "Diagnostics error", "Error occurred in diagnostics"),
    (0xd408, "Update aborted", "Diagnostic update broken off"),
    (0xd409, "DP bus error", "Error on the DP bus"),
    (0xd601, "Function parameter syntax error", "Security function: parameters cannot be parsed"),
    (0xd602, "Incorrect password", "Password wrong"),
    (0xd603, "Already legitimised", "The connection has been legitimised before"),
    (0xd604, "Already enabled", "The connection is already enabled (Snap7: no password to clear)"),
    (0xd605, "No password set", "Legitimisation impossible, there is no password (Snap7: none to set)"),
    (0xd801, "Invalid tag address", "Cyclic service: at least one address wrong"),
    (0xd802, "Job does not exist", "Cyclic service: job unknown"),
    (0xd803, "Illegal job status", "Cyclic service: status not allowed"),
    (0xd804, "Illegal cycle time", "Cyclic service: time base or multiple wrong"),
    (0xd805, "No more cyclic jobs", "Cyclic service: limit of jobs reached"),
    (0xd806, "Job state forbids function", "Cyclic service: the job is in the wrong state"),
    (0xd807, "Overload", "Cyclic service: reading takes longer than the scan cycle"),
    (0xdc01, "Invalid date or time", "Clock value not valid BCD or not a date"),
    (0xe201, "Already master", "H system: the CPU is already the master"),
    (0xe202, "Different user program in flash", "H system: connect and update not possible"),
    (0xe203, "Different firmware", "H system: connect and update not possible"),
    (0xe204, "Different memory configuration", "H system: connect and update not possible"),
    (0xe205, "Synchronisation error", "H system: connect or update aborted"),
    (0xe206, "Coordination violation", "H system: connect or update denied"),
    (0xef01, "Error at ID2, only 00H in a job", "Protocol error"),
    (0xef02, "Error at ID2, resource set missing", "Protocol error"),
]

#: Every error code, for all functions.
ERROR_CODES: Final = CodeTable("S7 error code", 4, _ROWS)

ERROR_CLASSES: Final = CodeTable(
    "S7 error class",
    2,
    [
        (0x00, "no error", "Nothing went wrong."),
        (0x81, "application relationship", "The relation between the two applications does not allow the request."),
        (0x82, "object definition", "The requested object is not defined as the request assumes."),
        (0x83, "no resources", "The module has no resources left for the request."),
        (0x84, "service processing", "The service could not be processed."),
        (0x85, "supplies", "The frame itself was faulty."),
        (0x87, "access", "Access to the object failed."),
    ],
)

#: The upper octets of other codes: they are not classes, but name the service of the code.
ERROR_SERVICES: Final = CodeTable(
    "S7 error service",
    2,
    [
        (0x01, "block administration", "The request about blocks could not be carried out."),
        (0x80, "state of the module", "The state of the block or of the module does not allow the request."),
        (0xd0, "test functions", "The test function could not be carried out."),
        (0xd2, "block functions", "The function on blocks could not be carried out."),
        (0xd4, "information functions", "The information, for example an SZL, could not be returned."),
        (0xd6, "security functions", "The function on passwords could not be carried out."),
        (0xd8, "cyclic services", "The cyclic service could not be carried out."),
        (0xdc, "time functions", "The function on the clock could not be carried out."),
        (0xe2, "redundancy", "The H system could not carry out the request."),
        (0xef, "protocol", "The message violated the protocol."),
    ],
)

_VARIABLES: Final = frozenset((READ_VAR, WRITE_VAR))
_UPLOADS: Final = frozenset((START_UPLOAD, UPLOAD, END_UPLOAD))
#: Functions that load, read out, link or copy blocks; userdata is included because of block functions and NC programming.
_BLOCKS: Final = _UPLOADS | {REQUEST_DOWNLOAD, DOWNLOAD_BLOCK, DOWNLOAD_ENDED, PI_SERVICE, CPU_SERVICES}

#: Codes whose row applies only to these functions. In an answer to any other function, only their class has a meaning.
_ONLY: Final[dict[int, frozenset[int]]] = {
    0x8003: _BLOCKS,
    0x8205: _BLOCKS,
    0x8304: _UPLOADS,
    0x8306: _BLOCKS,
    0x8307: _BLOCKS,
    0x8401: _BLOCKS,
}

#: Codes by which a protection level or a password refuses a request of any function.
_PROTECTED: Final = frozenset((0xD241, 0xD602))
#: Classes by which S7-1200/1500 refuse reads and writes while PUT/GET access is off, or of a block with optimized access; they
#: also use them for other reasons.
_PERHAPS: Final = range(0x81, 0x86)

#: The function of an answer that names none, such as most Acks, if its request is unknown.
NO_FUNCTION: Final = -1
#: Represents all functions that are not in the sets above.
_OTHER: Final = 0x100


def protects(code: int) -> bool:
    """Return whether an error code means that the PLC is protected."""
    return code in _PROTECTED


def may_protect(code: int, function: int) -> bool:
    """Return whether an error code may mean that the PLC is protected: it refuses a read or write, but is not specific."""
    return function in _VARIABLES and code >> 8 in _PERHAPS


class ErrorTable(CodeTable):
    """The error codes with their meaning for one function, `NO_FUNCTION` if the function is unknown.

    Its rows are the rows of `ERROR_CODES` that apply to the function. Any other code has the words of its class.
    """

    __slots__ = ("_function",)

    def __init__(self, function: int) -> None:
        rows = [row for row in _ROWS if function in _ONLY.get(row[0], (function,))]
        super().__init__(ERROR_CODES.title, ERROR_CODES.digits, rows)
        self._function = function

    def get(self, number: int) -> Code | None:
        """Return the row of an error code, or one made from its class; None if the class is unknown, too."""
        return super().get(number) or _of_class(number, self._function)

    def name(self, number: int) -> str:
        """Return the name of an error code, otherwise the text of its class; for an unknown class its hexadecimal form."""
        row = self.get(number)
        return row.name if row is not None else self.hex(number)

    def text(self, number: int) -> str:
        """Return the meaning of an error code, otherwise the meaning of its class; empty for an unknown class."""
        row = self.get(number)
        return row.text if row is not None else ""


def _of_class(number: int, function: int) -> Code | None:
    """Return a row with the text of a code's class, or of the service that it belongs to; None if that is unknown.

    Class 0 means "no error", which contradicts a code in it.
    """
    upper = number >> 8
    row = ERROR_CLASSES.get(upper) or ERROR_SERVICES.get(upper)
    if row is None or not upper:
        return None
    text = row.text
    if function == NO_FUNCTION and number in _ONLY:
        where = "an upload" if _ONLY[number] is _UPLOADS else "a function on blocks"
        text = f"{text} As the answer to {where}: {ERROR_CODES.name(number)}."
    return Code(number, _words(row), text)


def _words(row: Code) -> str:
    return f"{row.name} (error class {ERROR_CLASSES.hex(row.number)})"


def class_names() -> list[str]:
    """Return the names for codes without their own row, one for each class."""
    return [_words(row) for table in (ERROR_CLASSES, ERROR_SERVICES) for row in table if row.number]


_TABLES: Final[dict[int, CodeTable]] = {}


def errors_of(function: int) -> CodeTable:
    """Return the table of error codes for answers to ``function`` (its octet; for all of userdata that of userdata)."""
    kind = function if function in _BLOCKS or function in _VARIABLES or function == NO_FUNCTION else _OTHER
    table = _TABLES.get(kind)
    if table is None:
        table = _TABLES[kind] = ErrorTable(kind)
    return table
