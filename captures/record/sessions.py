"""The sessions: the programs that talk, the port, and the expected results."""

from __future__ import annotations

from typing import NamedTuple


class Promise(NamedTuple):
    """The expected results of the conversation's script, counted by reading the script; a recording that differs is not kept.

    ``asked`` counts the requests of both sides, Setup among them; ``header_errors`` the answers with an error in the header or,
    of Userdata, in the parameters.
    """

    connections: int
    asked: int
    unanswered: int = 0
    orphan_answers: int = 0
    item_errors: int = 0
    header_errors: int = 0


class Session(NamedTuple):
    """One recording.

    ``server`` is ``native`` (python-snap7 2: the Snap7 library in C++), ``python`` (python-snap7 3: pure Python) or empty;
    ``clients`` are ``PEER CONVERSATION``, started together; ``fault`` is one of the relay's; ``moment`` is ``late`` (the
    capture begins when the client reports its request) or ``kill`` (the client is killed then).
    """

    name: str
    port: int
    server: str
    clients: tuple[str, ...]
    promise: Promise
    purpose: str
    fault: str = ""
    moment: str = ""
    max_clients: int = 0


NATIVE, PYTHON = "native", "python"

CONNECTIONS = [
    Session(
        "connect-close", 102, PYTHON, ("python connect-close",), Promise(1, 1),
        "The clean life of a connection: CR/CC, Setup, DR/DC. The client closes TCP behind its DR without waiting, so the "
        "DC may be met with RST, which is no fault.",
    ),
    Session(
        "setup-pdu-sizes", 102, NATIVE, ("native setup-pdu-sizes",), Promise(3, 3),
        "Three connections that negotiate a PDU length of 240, 480 and 960; closed by FIN without a DR.",
    ),
    Session(
        "refused-port", 102, "", ("native refused-port",), Promise(0, 0),
        "Refused by TCP: nobody listens, the SYN is answered with RST. No connection comes about.",
    ),
    Session(
        "refused-full", 102, PYTHON, ("python refused-full",), Promise(2, 2), max_clients=1,
        purpose="Refused by a full server: the second client's connection is accepted and at once reset, its CR is never "
        "answered. (None of the peers used here ever refuses with a DR, whatever TSAP is called; that case has to be crafted.)",
    ),
    Session(
        "two-clients", 102, NATIVE, ("native two-clients", "python two-clients"), Promise(2, 26),
        "Two clients of different make at one server at the same time, with PDU references of both byte orders.",
    ),
    Session(
        "mid-stream", 102, NATIVE, ("native mid-stream",), Promise(1, 4, orphan_answers=1), fault="slow", moment="late",
        purpose="The capture begins in the middle of a connection, with a request open whose answer is the first PDU seen.",
    ),
]  # fmt: skip

VARIABLES = [
    Session(
        "read-areas", 102, NATIVE, ("native read-areas",), Promise(1, 73),
        "Reads of every area with every transport size, one and several elements; then DB2, where every type has its value.",
    ),
    Session(
        "read-areas-python", 1102, PYTHON, ("python read-areas",), Promise(1, 63),
        "The same from pure Python peers, on another port: this server answers every size as BYTE/WORD with a length in bits.",
    ),
    Session(
        "write-areas", 102, NATIVE, ("native write-areas",), Promise(1, 65),
        "Writes of every area with every transport size, odd sizes among them.",
    ),
    Session(
        "write-areas-python", 1102, PYTHON, ("python write-areas",), Promise(1, 63),
        "The same from pure Python peers, on another port.",
    ),
    Session(
        "multi-items", 102, NATIVE, ("native multi-items",), Promise(1, 10),
        "20 items in one read and in one write, with fill octets; a read and a write that need two PDUs.",
    ),
    Session(
        "multi-items-python", 1102, PYTHON, ("python multi-items",), Promise(1, 5),
        "20 scattered variables in one read, then 20 neighbours that the client merges into one item.",
    ),
    Session(
        "many-open", 102, PYTHON, ("python many-open",), Promise(1, 10), fault="busy",
        purpose="A client that sends three jobs before it reads an answer, though Setup granted one: more open jobs than AmQ.",
    ),
    Session(
        "item-errors", 102, NATIVE, ("native item-errors",), Promise(1, 8, item_errors=13),
        "Missing DB and addresses out of range, alone and among good items, in reading and in writing. A failed item of this "
        "server claims a length of 4 and has no data. In the write of several items it loses its place behind a REAL: two good "
        "items are refused with 0x07.",
    ),
    Session(
        "item-errors-python", 1102, PYTHON, ("python item-errors",), Promise(1, 6, item_errors=3, header_errors=2),
        "The same from pure Python peers: a failed read has an item return code, a failed write ROSCTR 2 with an error.",
    ),
]  # fmt: skip

NODES7 = [
    Session(
        "nodes7-poll", 102, NATIVE, ("nodes7 poll",), Promise(1, 6),
        "Five rounds of polling by nodes7, which merges neighbours and packs items: its own Setup, references and TSAPs.",
    ),
    Session(
        "nodes7-poll-unmerged", 1102, NATIVE, ("nodes7 poll-unmerged",), Promise(1, 3),
        "The same variables, each its own item, on another port.",
    ),
    Session(
        "nodes7-poll-parallel", 102, NATIVE, ("nodes7 poll-parallel",), Promise(1, 7), fault="busy",
        purpose="nodes7 with more variables than one PDU holds: two jobs open at once, which Setup granted.",
    ),
    Session(
        "nodes7-poll-missing", 102, NATIVE, ("nodes7 poll-missing",), Promise(1, 3, item_errors=4),
        "A poll that has one variable in a missing DB and one behind the end of a DB, again in every round.",
    ),
    Session(
        "nodes7-write", 1102, NATIVE, ("nodes7 write",), Promise(1, 7),
        "Writes by nodes7, single and several variables at a time, bits and a string among them, on another port.",
    ),
]  # fmt: skip

SERVICES = [
    Session(
        "szl", 102, NATIVE, ("native szl",), Promise(1, 16, header_errors=1),
        "System status lists: the list of lists, 0x0011, 0x001C, 0x0424, 0x0131, 0x0232 and more, an unknown id.",
    ),
    Session(
        "szl-python", 1102, PYTHON, ("python szl",), Promise(1, 8),
        "The same from pure Python peers: this server says no with a return code in the data and leaves the error code 0.",
    ),
    Session(
        "blocks", 102, NATIVE, ("native blocks",),
        Promise(1, 10, unanswered=2, orphan_answers=2, header_errors=5),
        "Block list, list of type (three without a block), block info (two of missing blocks). The refusals of these carry "
        "the PDU reference of the last good answer, a defect of this server: two requests stay open, two answers are orphans.",
    ),
    Session(
        "blocks-python", 1102, PYTHON, ("python blocks",), Promise(1, 6),
        "The same from pure Python peers. The refusal of block info names group 4, subfunction 1, which was not asked.",
    ),
    Session("clock", 102, NATIVE, ("native clock",), Promise(1, 5), "Clock read, set twice, read."),
    Session("clock-python", 1102, PYTHON, ("python clock",), Promise(1, 4), "Clock read, set, read, from pure Python peers."),
    Session(
        "password", 102, NATIVE, ("native password",), Promise(1, 5),
        "Session password set twice and cleared; the passwords are made up.",
    ),
    Session(
        "plc-control", 102, NATIVE, ("native plc-control",), Promise(1, 11),
        "PLC stop (again when stopped), hot start, cold start, compress, copy RAM to ROM, delete a block; CPU state between.",
    ),
    Session(
        "transfer", 102, PYTHON, ("python transfer",), Promise(1, 17, header_errors=2),
        "Upload and download of a block, in one part and in two. In the download the server asks and the client answers. "
        "A missing block is refused in either direction.",
    ),
    Session(
        "program-python", 102, PYTHON, ("python program",), Promise(1, 13),
        "A program of our own (OB 1, FC 5, FB 7) is loaded, then OB 1 again with one time value changed. The client calls each "
        "of them DB 1; the header of a block says what it is.",
    ),
    Session(
        "transfer-refused", 102, NATIVE, ("native transfer-refused",), Promise(1, 4, header_errors=3),
        "Uploads refused by the protection level: ROSCTR 2 with error class and code.",
    ),
    Session(
        "bsend", 102, "", ("partner",), Promise(1, 7),
        "Two Snap7 partners: BSEND from either end over one connection, one in four parts.",
    ),
]  # fmt: skip

FAULTS = [
    Session(
        "cut-with-reset", 102, NATIVE, ("native cut",), Promise(1, 4, unanswered=1), fault="cut-with-reset",
        purpose="The serving side resets the connection while a request is open.",
    ),
    Session(
        "cut-with-fin", 102, NATIVE, ("native cut",), Promise(1, 4, unanswered=1), fault="cut-with-fin",
        purpose="The serving side ends the connection properly while a request is open.",
    ),
    Session(
        "client-killed", 102, NATIVE, ("native interrupted",), Promise(1, 4, unanswered=1), fault="lose-all", moment="kill",
        purpose="The client's process is killed while it waits for an answer.",
    ),
    Session(
        "answer-after-fin", 102, NATIVE, ("native give-up",), Promise(1, 4), fault="slow",
        purpose="The client gives up and closes; the answer comes after its FIN and is met with RST.",
    ),
    Session(
        "answer-lost", 102, NATIVE, ("native lost",), Promise(1, 7, unanswered=1), fault="lose",
        purpose="One answer never comes; the client times out and polls on over the same connection.",
    ),
    Session(
        "answer-twice", 102, PYTHON, ("python twice",), Promise(1, 7, orphan_answers=1), fault="twice",
        purpose="One answer is sent twice, as new octets: the second belongs to nobody.",
    ),
    Session(
        "answer-slow", 102, NATIVE, ("native slow",), Promise(1, 7), fault="slow",
        purpose="One answer of six takes 1.5 s, the others less than a millisecond or two.",
    ),
    Session(
        "slivers", 2102, NATIVE, ("native slivers",), Promise(1, 6, item_errors=1), fault="slivers",
        purpose="Answers in segments of 7 octets: every TPKT lies over several. On another port.",
    ),
    Session(
        "batched", 102, PYTHON, ("python pairs",), Promise(1, 7), fault="batched",
        purpose="Two answers in one segment, and two jobs open at once.",
    ),
]  # fmt: skip

SESSIONS = CONNECTIONS + VARIABLES + NODES7 + SERVICES + FAULTS
