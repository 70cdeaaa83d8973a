"""Write docs/coverage.md: for each row of the tables, whether it is decoded, built, seen and compared.

PYTHONPATH=. python scripts/coverage_doc.py [FOLDER of the public captures] > docs/coverage.md
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from dissect.engine.observer import Observer
from dissect.files.session import Run
from dissect.layers import S7, TPKT
from dissect.layers.parts import CLASSES
from dissect.protocols.iso import tables as iso
from dissect.protocols.iso.cotp import parse_tpdu
from dissect.protocols.s7 import szl_tables, tables
from dissect.protocols.s7.bodies import parse_body
from dissect.protocols.s7.body import Body
from dissect.protocols.s7.message import Pdu, parse_pdu
from dissect.protocols.s7.parameters import PUSH, REQUEST, RESPONSE
from dissect.protocols.s7.services import PI_SERVICES
from dissect.protocols.s7.szl import SZL_HEAD
from dissect.protocols.s7.szl_records import RECORD
from dissect.testing.oracle import facts, known
from dissect.testing.oracle.facts import TPKT_SIZE
from dissect.wire.codes import CodeTable
from dissect.wire.part import OCTETS, SURPLUS, Part

ROOT: Final = Path(__file__).resolve().parents[1]
PAGE: Final = ROOT / "docs" / "coverage.md"
SHARED, RECORDED, CRAFTED = range(3)
KINDS: Final = {PUSH: "push", REQUEST: "request", RESPONSE: "response"}
#: The crafted captures without faults, which contain every row; decoding and building are judged by them.
SOUND: Final = ("coverage-", "reference-examples", "cotp-tpdus", "cotp-refused")
#: COTP parameters whose value is read, with its field; of all others only code and length are compared.
_VALUES: Final = {0xC0: facts.TPDU_SIZE, 0xC1: facts.CALLING_TSAP, 0xC2: facts.CALLED_TSAP}
#: Tables whose rows are values of a field; every layout with such a field counts.
VALUES: Final = {
    "Syntax ids": tables.SYNTAX_IDS,
    "Areas": tables.AREAS,
    "Transport sizes of request items": tables.TRANSPORT_SIZES,
    "Transport sizes of data items": tables.DATA_TRANSPORT_SIZES,
    "Return codes": tables.RETURN_CODES,
}
TPDUS, PARAMETERS, FUNCTIONS, USERDATA = "COTP TPDUs", "COTP parameters", "Functions", "Userdata"
BLOCKS, SERVICES, LISTS = "Block types", "PI services", "System status lists"
DECODED, BUILT, SEEN, COMPARED = "decoded", "built", "seen", "compared"
Key = tuple[str, str]
"""Section and row."""

_PROGRAMMER: Final = "bytes: no source tells what its data mean"
_ROUTING: Final = "bytes: of data record routing nobody published more than the names"
_RECORDS: Final = "head decoded, records bytes: no source at hand describes them"
_ADDRESSES: Final = (
    "no capture shows one, and no source confirms how Wireshark reads it (items instead of a length); as any data item"
)
_UNIT_DATA: Final = (
    "belongs to connectionless transport, which does not run over TCP; kept as bytes (`COTP_Unknown`) and reported"
)
#: Lists whose records are unknown.
_PLAIN_LISTS: Final = (0x16, 0x17, 0x18, 0x21, 0x23, 0x33, 0x81, 0x82, 0xB4)


#: Known differences (`dissect.testing.oracle.known`) under which most of a row is compared, by section and beginning of the
#: row.
DIFFERENCES: Final = {
    (TPDUS, "ED"): "expedited-refused",
    (FUNCTIONS, "0x01 push"): "mode-transition-as-head",
    (USERDATA, "0x00/"): "mode-transition-as-head",
    (USERDATA, "0x04/0x10"): "archive-as-octets",
    (USERDATA, "0x20/"): "userdata-type-of-four-bits",
    (USERDATA, "0x3f/"): "userdata-type-of-four-bits",
    ("Areas", "0x01 "): "address-of-a-record",
    **{(LISTS, f"0x{partial:02x}"): "records-as-octets" for partial in (0x00, 0x22, 0x24, 0x31, 0x32)},
    **{
        (LISTS, f"0x{partial:02x}"): "records-without-names"
        for partial in (0x25, 0x37, 0x71, 0x75, 0x90, 0x95, 0xB1, 0xB2, 0xB3)
    },
}


def reasons() -> dict[tuple[str, str, str], str]:
    """Return why a cell is empty, by section, row and column. A test finds those that are missing or no longer needed."""
    told = {(TPDUS, "UD", column): _UNIT_DATA for column in (DECODED, BUILT, SEEN, COMPARED)}
    for number, kind in ((0x06, PUSH), (0x06, REQUEST), (0x07, REQUEST), (0x16, REQUEST)):
        told[USERDATA, userdata_name(1, number, kind), DECODED] = _PROGRAMMER
    told[USERDATA, userdata_name(4, 1, RESPONSE), DECODED] = "see the lists below: records of some are bytes"
    for row in tables.USERDATA_SUBFUNCTIONS[0x20]:
        for kind in (REQUEST, RESPONSE):
            told[USERDATA, userdata_name(0x20, row.number, kind), DECODED] = _ROUTING
            told[USERDATA, userdata_name(0x20, row.number, kind), COMPARED] = _ROUTING
    for number in (0x11, 0x12):
        for column in (DECODED, BUILT, SEEN, COMPARED):
            told["Transport sizes of data items", value_name(tables.DATA_TRANSPORT_SIZES, number), column] = _ADDRESSES
    for partial in _PLAIN_LISTS:
        told[LISTS, list_name(partial), DECODED] = _RECORDS
    return told


class Row:
    """The findings for a row."""

    def __init__(self) -> None:
        self.seen = [0, 0, 0]
        self.layouts: set[str] = set()
        self.octets = False
        self.classes: set[str] = set()
        self.fields: set[str] = set()


class Census(Observer):
    """Counts the rows of all PDUs and TPDUs of one kind of captures; ``judged`` ones also show how they are decoded."""

    def __init__(self, rows: dict[Key, Row], source: int) -> None:
        super().__init__()
        self.wants_pdus = True
        self.wants_tpdus = True
        self.rows = rows
        self.source = source
        self.judged = False

    def of(self, path: Path) -> None:
        """Read a capture."""
        self.judged = self.source == CRAFTED and path.name.startswith(SOUND)
        run = Run([str(path)], self)
        while run.step():
            pass

    def tpdu(self, frame: int, time_ns: int, side: object, octets: bytes) -> None:
        """Count a TPDU and its parameters (`Observer`)."""
        tpdu = parse_tpdu(octets[TPKT_SIZE:])
        if tpdu.malformed or tpdu.type not in iso.TPDU_TYPES:
            return
        row = self.count(TPDUS, iso.TPDU_TYPES.name(tpdu.type))
        names = {value.field.wireshark for value in tpdu.fields if value.field.wireshark}
        layer = TPKT(octets).payload if self.judged else None
        for parameter in tpdu.parameters:
            if parameter.code in iso.PARAMETERS:
                one = self.count(PARAMETERS, f"0x{parameter.code:02x} {iso.PARAMETERS.name(parameter.code)}")
                if layer is not None:
                    value = _VALUES.get(parameter.code)
                    one.layouts.add("code, length, value" if value else "code, length; value as bytes")
                    one.classes.add("COTP_Parameter")
                    one.fields |= facts.NAMES[facts.IN_PARAMETER] | ({value} if value else set())
        if layer is not None:
            row.layouts.add(iso.TPDU_TYPES.name(tpdu.type))
            row.classes.add(type(layer).__name__)
            row.fields |= names

    def pdu(self, frame: int, time_ns: int, side: object, octets: bytes, cut: bool) -> None:
        """Count the rows of an S7 PDU (`Observer`)."""
        pdu = parse_pdu(octets)
        body = parse_body(pdu)
        if cut or pdu.malformed or body.malformed:
            return
        parts = body.parts
        classes = bodies(octets) if self.judged else set()
        for section, name, own in rows_of(pdu, body):
            row = self.count(section, name)
            if self.judged:
                judge(row, own or parts, classes)

    def count(self, section: str, name: str) -> Row:
        """Count a row once more."""
        row = self.rows.setdefault((section, name), Row())
        row.seen[self.source] += 1
        return row


def bodies(octets: bytes) -> set[str]:
    """Return the class of the body of a PDU, after building it again."""
    packet = S7(octets)
    packet.clear_cache()
    return {type(packet.payload).__name__} if bytes(packet) == octets else set()


def judge(row: Row, parts: list[Part], classes: set[str]) -> None:
    """Note how parts are decoded, built and compared."""
    row.classes |= classes
    for part in parts:
        if part.layout in (OCTETS, SURPLUS, RECORD):
            row.octets = True
            continue
        row.layouts.add(part.layout.name)
        if part.layout in CLASSES:
            row.classes.add(CLASSES[part.layout].__name__)
        row.fields |= {value.field.wireshark for value in part.values if value.field.wireshark}


def rows_of(pdu: Pdu, body: Body) -> Iterable[tuple[str, str, list[Part]]]:
    """Return the rows that a PDU belongs to: section, row, the parts of the row (all if there are none)."""
    head = pdu.parameters.userdata
    function = pdu.function
    if head is not None and function == 0 and not head.usend:
        payload = [part for part in body.data if part.offset > pdu.data_offset]
        yield USERDATA, userdata_name(head.group, head.subfunction, head.type), payload or body.data
    elif head is None and function in tables.FUNCTIONS and pdu.rosctr in tables.ROSCTR:
        yield FUNCTIONS, f"0x{function:02x} {'job' if pdu.rosctr == tables.JOB else 'answer'}", []
    if head is not None and function == tables.MODE_TRANSITION:
        yield FUNCTIONS, "0x01 push", []
        yield USERDATA, userdata_name(0, head.subfunction, PUSH), []
    for key in {(section, value, part) for section, value, part in values_of(body.parts)}:
        yield key[0], key[1], [key[2]]
    service = body.text("service")
    if service in PI_SERVICES and function == tables.PI_SERVICE:
        yield SERVICES, service, body.parameters
    found = body.find(SZL_HEAD)
    if found is not None and found.number("record_count"):
        partial = found.number("szl_id") & 0xFF
        if partial in szl_tables.PARTIAL_LISTS:
            yield LISTS, list_name(partial), [part for part in body.data if part.offset >= found.offset]


def values_of(parts: list[Part]) -> Iterable[tuple[str, str, Part]]:
    """Return the values of fields that are rows."""
    for part in parts:
        for value in part.values:
            codes = value.field.codes
            for section, table in VALUES.items():
                if codes is table and value.value in table:
                    yield section, value_name(table, value.value), part
            text = (value.octets or b"").decode("latin-1")
            if value.field.name == "block_type" and text in tables.BLOCK_TYPES:
                yield BLOCKS, f"{text} {tables.BLOCK_TYPES[text]}", part


def value_name(table: CodeTable, number: int) -> str:
    """Return the name of a row that is a value."""
    return f"{table.hex(number)} {table.name(number)}"


def userdata_name(group: int, subfunction: int, kind: int) -> str:
    """Name a row of userdata."""
    table = tables.USERDATA_SUBFUNCTIONS.get(group)
    name = table.name(subfunction) if table is not None else ""
    return f"0x{group:02x}/0x{subfunction:02x} {name}, {KINDS.get(kind, '?')}"


def list_name(partial: int) -> str:
    """Name a row of system status lists."""
    return f"0x{partial:02x} {szl_tables.PARTIAL_LISTS.name(partial)}"


def expected() -> dict[str, list[str]]:
    """Return the rows of every section, from the tables."""
    functions = [
        f"0x{row.number:02x} {kind}"
        for row in tables.FUNCTIONS
        for kind in (("push",) if row.number == tables.MODE_TRANSITION else ("job", "answer"))
    ]
    userdata = [
        userdata_name(group, row.number, kind)
        for group, table in tables.USERDATA_SUBFUNCTIONS.items()
        for row in table
        for kind, name in KINDS.items()
        if name in row.text.partition(";")[0].lower().rstrip(".").split("/")
    ]
    return {
        TPDUS: [row.name for row in iso.TPDU_TYPES],
        PARAMETERS: [f"0x{row.number:02x} {row.name}" for row in iso.PARAMETERS],
        FUNCTIONS: functions,
        USERDATA: userdata,
        **{section: [value_name(table, row.number) for row in table] for section, table in VALUES.items()},
        BLOCKS: [f"{digits} {name}" for digits, name in tables.BLOCK_TYPES.items()],
        SERVICES: list(PI_SERVICES),
        LISTS: [list_name(row.number) for row in szl_tables.PARTIAL_LISTS],
    }


def census(shared: Path | None) -> dict[Key, Row]:
    """Read all captures; the public ones only if they are available."""
    rows: dict[Key, Row] = {}
    folders = {RECORDED: ROOT / "captures", CRAFTED: ROOT / "captures" / "crafted"}
    if shared is not None:
        folders[SHARED] = shared
    for source, folder in folders.items():
        counter = Census(rows, source)
        for path in sorted(folder.glob("*.pc*")):
            if not path.name.startswith("cut-"):
                counter.of(path)
    return rows


def cells(section: str, name: str, row: Row) -> dict[str, str]:
    """Return the text of each column; empty if there is nothing to say."""
    decoded = ", ".join(sorted(row.layouts)) if row.layouts and not row.octets else ""
    return {
        DECODED: decoded,
        BUILT: ", ".join(f"`{one}`" for one in sorted(row.classes)),
        SEEN: " / ".join(str(count) for count in row.seen) if any(row.seen) else "",
        COMPARED: f"{len(row.fields)} field{'s' * (len(row.fields) != 1)}{difference(section, name)}"
        if row.fields
        else "",
    }


def difference(section: str, name: str) -> str:
    """Return the known difference of a row, for the place after the compared fields."""
    found = [one for (place, start), one in DIFFERENCES.items() if place == section and name.startswith(start)]
    return f", `{found[0]}`" if found else ""


def document(rows: dict[Key, Row]) -> str:
    """Return the page."""
    lines = [*HEAD]
    why = reasons()
    for section, names in expected().items():
        lines += ["", f"## {section}", "", "| row | decoded as | built by | seen | compared |", "|---|---|---|---|---|"]
        for name in names:
            told = cells(section, name, rows.get((section, name), Row()))
            shown = [text or why.get((section, name, column), "") for column, text in told.items()]
            lines.append(f"| {name} | {' | '.join(shown)} |")
        lines += BELOW.get(section, ())
    return "\n".join(lines) + "\n"


def faults(rows: dict[Key, Row]) -> list[str]:
    """Return the empty cells without a reason, and the reasons that nothing needs."""
    why = reasons()
    needed = set()
    for section, names in expected().items():
        for name in names:
            for column, text in cells(section, name, rows.get((section, name), Row())).items():
                if not text:
                    needed.add((section, name, column))
    told = [f"no reason: {one}" for one in sorted(needed - why.keys())]
    return told + [f"not needed: {one}" for one in sorted(why.keys() - needed)]


HEAD: Final = (
    "# Coverage",
    "",
    "Made from the tables and the captures (`scripts/coverage_doc.py`); a test keeps it so, and fails for an empty cell",
    "that has no reason.",
    "",
    "- *decoded as*: the structures that `parse_body` cuts, where no bytes without a meaning are left",
    "- *built by*: the Scapy classes that dissect such PDUs and give the same bytes again",
    "- *seen*: PDUs in the public captures / recorded here / crafted here; PDUs with a fault are not counted",
    "- *compared*: how many fields have a name of Wireshark's. In every capture [the oracle](oracle.md) compares them with",
    f"  tshark, and none is unexplained; where they differ on purpose its entry is named ({len(known.KNOWN)} there in all).",
)


#: The text below the table of a section.
BELOW: Final[dict[str, tuple[str, ...]]] = {
    TPDUS: (
        "",
        "### Behind a malformed header",
        "",
        "A TPDU header cannot hold a DT of class 0 where its length indicator is 0, 1 or the reserved 255, or reaches",
        "beyond the TPKT. A receiver that reads the header drops such a TPDU; one that skips three bytes accepts the",
        "rest. So a whole S7comm PDU or S7comm-plus frame behind such a header, of whatever type and end mark, is",
        "shown and judged, but counted apart:",
        "",
        "- It is marked: `BEHIND A MALFORMED TPDU HEADER` in `show`, `tpdu.behind_malformed` in its JSON, the reason",
        "  `malformed_header` of its transaction, `behind_malformed` in `-Y`. `cotp.malformed` names the header.",
        "- Its security findings are made and say so. It opens no request, breaks no limit (PDU length, parallel",
        "  jobs, setup), and begins no operation.",
        "- Such a request is kept separately for 10 s, up to 8 of them and 64 KiB on a connection. If the other side answers",
        "  it, and no ordinary request of that reference is open, both are one transaction: the device accepted it. Else its",
        "  outcome is `behind_malformed`, and nothing is missed.",
        "- An answer completes the open request that it fits if no other answer comes within 1 s or 50 packets, or",
        "  once its client sends more requests than it may have open. Any other one, and a push, is",
        "  `behind_malformed`.",
        "",
        "A DT whose length indicator is 3 or more and lies within its TPKT is read: if a whole PDU is at the place of data in",
        "class 0, the data begin there, otherwise at the place that the length indicator gives.",
    ),
}


def main(arguments: list[str]) -> int:
    """Print the page; returns the exit code."""
    rows = census(Path(arguments[0]) if arguments else None)
    print(document(rows), end="")
    wrong = faults(rows)
    print("\n".join(wrong), file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
