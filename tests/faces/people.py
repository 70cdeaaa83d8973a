"""The text outputs as records: lines of transactions, operations, values and PDUs, and the report of `analyze`.

Each pattern names its parts; the names are those used in `tests.faces.facts`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any, Final

from dissect.engine.transactions.transaction import HOLE, MALFORMED_HEADER, PERHAPS_ANSWERED, REASON_TEXTS
from dissect.meaning.report.certainty import SHORT
from dissect.meaning.report.facets import REASONS
from dissect.meaning.report.operations import NAMES
from tests.faces.kinds import UNTOLD

Record = dict[str, Any]

_MOMENT: Final = r"(?P<time>\d{4}-\d\d-\d\d \d\d:\d\d:\d\d\.\d{6} UTC)"
_ENDS: Final = r"(?P<sender>\S+) → (?P<receiver>\S+)"
_TOOK: Final = r"(?P<took>-|\?|-?[\d.]+ (?:µs|ms|s)|(?:\d+ (?:d|h|min|s) ?)+)"
_TALK: Final = re.compile(
    rf"{_MOMENT}  #(?P<number>\d+) +(?P<first>[\d?]+)→(?P<last>[\d?]+) +{_ENDS}  +{_TOOK}  (?P<rest>.*)"
)
_ENDINGS: Final = (
    ("answer without request", "orphan_answer"),
    ("push", "unsolicited"),
    ("one way", "unsolicited"),
    ("NO ANSWER", "unanswered"),
    ("answer not captured", "unanswered"),
    (REASON_TEXTS[HOLE], "unanswered"),
    (PERHAPS_ANSWERED, "unanswered"),
)
_WHY: Final = re.compile(r"(?:NO ANSWER|answer without request) \((?P<why>[^)]*)\)")
_REFUSED: Final = re.compile(r"(?:^|, |  )(?:PARTLY )?REFUSED (?:abort )?(?P<code>0x[0-9a-f]+|-\d+)")


def transactions(lines: list[str]) -> Iterator[Record]:
    """Yield the contents of the lines of transactions."""
    reasons = {said: reason for reason, said in REASONS.items()}
    for line in lines:
        record = _talk(line)
        parts = record["rest"].split("  ")
        record["function"] = parts[0]
        said = next(
            ((begin, outcome) for begin, outcome in _ENDINGS if len(parts) > 1 and parts[1].startswith(begin)), None
        )
        record["outcome"] = said[1] if said is not None else "answered"
        ending = parts[1] if len(parts) > 1 else ""
        why = _WHY.match(ending)
        record["reason"] = reasons[why["why"]] if why else None
        record["behind"] = ending.startswith(REASONS[MALFORMED_HEADER])
        if record["behind"]:
            record["reason"] = MALFORMED_HEADER
            if record["first"] is None or record["last"] is None:
                record["outcome"] = "behind_malformed"
        if said is not None and said[0] in {REASON_TEXTS[HOLE], PERHAPS_ANSWERED}:
            record["reason"] = HOLE
        elif said is not None and said[0] == "answer not captured":
            record["reason"] = "one_sided"
        doubt = next((doubt for doubt, short in SHORT.items() if line.endswith(f"(likely: {short})")), None)
        record["doubt"] = doubt
        sure = record["outcome"] == "answered" or ending.startswith(REASON_TEXTS[HOLE])
        record["certainty"] = "likely" if doubt or ending.startswith(PERHAPS_ANSWERED) else "sure" if sure else None
        refused = _REFUSED.search(ending)
        record["error"] = int(refused["code"], 0) if refused else None
        ended = said is not None or refused is not None or record["behind"]
        ended = ended or ending.startswith(("MISMATCH", "request sent again"))
        record["items"] = list(_items(parts, ended))
        yield record


def _talk(line: str) -> Record:
    found = _TALK.fullmatch(line)
    assert found is not None, f"no line of a transaction or an operation: {line!r}"
    record: Record = found.groupdict()
    for name in ("first", "last"):
        record[name] = None if record[name] == "?" else record[name]
    # An answer that was captured before its request, or a clock that went backwards: the line states that the time is unknown.
    record["took"] = {"-": None, "?": UNTOLD}.get(record["took"], record["took"])
    return record


_ITEM: Final = re.compile(
    r"(?P<label>.+?)(?: = (?P<value>.*?))?(?P<odd> \([^)]*\))?(?:: (?P<result>[A-Z][^:']*|no return code))?"
)


def _items(parts: list[str], ended: bool) -> Iterator[Record]:
    """Yield the items of a line of a read or write; other functions have their own wording."""
    if parts[0] not in {"Read Var", "Write Var"} or len(parts) <= 1 + ended:
        return
    for text in _commas(parts[1 + ended].partition("; SCD ")[0]):
        found = _ITEM.fullmatch(text)
        yield found.groupdict() if found is not None else {"label": None, "text": text}


def _commas(text: str) -> Iterator[str]:
    """Yield the parts of a text between commas that are in neither brackets nor quotes."""
    begin, depth, quoted = 0, 0, False
    for at, character in enumerate(text):
        if character == "'" and text[at - 1 : at] != "\\":
            quoted = not quoted
        elif not quoted and character in "[{(":
            depth += 1
        elif not quoted and character in "]})":
            depth -= 1
        elif not quoted and not depth and text.startswith(", ", at):
            yield text[begin:at]
            begin = at + 2
    yield text[begin:]


_CARRIED: Final = re.compile(
    r"(?P<count>\d+) (?P<what>transactions?|pushe?s?)|(?P<octets>\d+)(?: of (?P<announced>\d+))? bytes"
)
_RESULTS: Final = {"outcome not captured": "not_captured", "ended with the connection": "running"}


def operations(lines: list[str]) -> Iterator[Record]:
    """Yield the contents of the lines of operations."""
    kinds = {said: kind for kind, said in NAMES.items()}
    for line in lines:
        record = _talk(line)
        parts = record["rest"].split("  ")
        record["kind"] = kinds[parts[0]]
        result = re.match(r"outcome not captured|ended with the connection|\w+", parts[-1])
        assert result is not None
        record["result"] = _RESULTS.get(result[0], result[0].lower())
        refused = re.search(r"\b(0x[0-9a-f]+) ", parts[-1])
        record["error"] = int(refused[1], 16) if refused and record["result"] == "refused" else None
        record["subject"] = parts[1] if len(parts) > 2 else UNTOLD
        carried = next((one for one in reversed(parts[1:-1]) if _CARRIED.match(one)), "")
        record |= {"parts": 1, "pushes": 0, "octets": None}
        for one in carried.split(", "):
            found = re.fullmatch(r"(\d+) (transaction|pushe?)s?(?: of them)?", one)
            if found and found[2] == "transaction":
                record["parts"] = int(found[1])
            elif found:
                record["pushes"] = int(found[1])
                record["parts"] = record["parts"] if "transaction" in carried else int(found[1])
            elif size := re.fullmatch(r"(\d+)(?: of (\d+))? bytes", one):
                record["octets"] = int(size[1])
        yield record


_VALUE: Final = re.compile(rf"{_MOMENT} +(?P<frame>\d+)  (?P<client>\S+) → (?P<plc>\S+)  (?P<how>\w+) +(?P<rest>.*)")


def values(lines: list[str]) -> Iterator[Record]:
    """Yield the contents of the lines of values; ``rest`` is the variable with its type, value and remarks."""
    for line in lines:
        found = _VALUE.fullmatch(line)
        assert found is not None, f"no line of a value: {line!r}"
        record: Record = found.groupdict()
        what, _, rest = record["rest"].partition(" = ")
        record["what"] = what
        value, was, _ = rest.partition("  was ")
        record["value"] = re.sub(r"  (\[.*\]|\(likely: .*\))$", "", value)
        record["was"] = bool(was)
        doubt = next((doubt for doubt, short in SHORT.items() if line.endswith(f"(likely: {short})")), None)
        record["doubt"] = doubt
        yield record


_MESSAGE: Final = re.compile(
    rf" *(?P<frame>\d+)  {_MOMENT}  {_ENDS}  "
    r"(?:COTP (?P<cotp>\S+).*|IBH (?P<netlink>.*)|SCD (?P<scd>.*)|S7comm-plus (?P<plus>.*)"
    r"|(?P<kind>\S+) +ref (?P<ref>0x[0-9a-f]+|\?)(?:  (?P<rest>.*))?)"
)
_PLUS: Final = re.compile(r"(?P<opcode>\S+(?: \S+)*) *(?:  seq (?P<sequence>\d+))?(?:  (?P<rest>.*))?")
_COMMENT: Final = re.compile(r" *\d+  comment: ")


def messages(lines: list[str]) -> Iterator[Record]:
    """Yield the contents of the lines of `show`."""
    for line in lines:
        if _COMMENT.match(line):
            continue
        found = _MESSAGE.fullmatch(line)
        assert found is not None, f"no line of a message: {line!r}"
        record: Record = found.groupdict()
        names = {"cotp": "cotp", "netlink": "ibh_netlink", "scd": "scd", "plus": "s7comm_plus", "kind": "s7comm"}
        record["protocol"] = next(protocol for name, protocol in names.items() if record[name] is not None)
        if record["kind"] is not None:
            record["ref"] = int(record["ref"], 16) if record["ref"] != "?" else None
        elif record["plus"] is not None:
            plus = _PLUS.fullmatch(record["plus"])
            assert plus is not None, line
            record |= {"kind": plus["opcode"].lower(), "ref": plus["sequence"] or UNTOLD, "rest": plus["rest"]}
        record["function"] = (record["rest"] or "").split("  ")[0]
        record["behind"] = "BEHIND A MALFORMED TPDU HEADER" in line
        record["cut"] = "TRUNCATED by the capture" in line or "CUT, the end is missing" in line
        yield record


# ---- the report of analyze ------------------------------------------------------------------------------------------


def sections(lines: list[str]) -> dict[str, list[str]]:
    """Return the lines of each section of the report, by the first word of its heading."""
    found: dict[str, list[str]] = {"": []}
    name = ""
    blank = False
    for line in lines:
        if not line:
            blank = True
            continue
        if blank and not line.startswith(" "):
            name = re.split(r"[ :]", line)[0]
            found[name] = [line]
        else:
            found[name].append(line)
        blank = False
    return found


_CONNECTION: Final = re.compile(
    r"  (?P<number>\d+)  (?P<client>\S+?) (?P<arrow>[→↔]) (?P<server>\S+?)(?P<udp> UDP)?(?:, (?P<more>.*))?"
)
_COUNTS: Final = (
    ("pdus", r"PDUs?"), ("answered", "answered"), ("missed", "unanswered"), ("still_open", "still open"),
    ("not_captured", "answers? not captured"), ("orphans", "answers? without request"), ("pushes", "push(?:es)?"),
    ("one_way", "one-way requests?"), ("errors", "with errors"), ("events", "system events?"),
    ("behind", "more behind malformed headers"),
)  # fmt: skip
_CLOSED: Final = re.compile(
    r"(?P<begun>already open at the start, )?(?P<deed>closed|reset) by the (?P<role>client|server)"
    r"(?: at packet (?P<frame>\d+))?(?P<tpdu> \(COTP (?:disconnect request|error TPDU))?"
)
_PENDING: Final = re.compile(r" with (\d+) requests? pending")


def connections(report: dict[str, list[str]]) -> Iterator[Record]:
    """Yield the report's facts about each connection."""
    blocks: list[list[str]] = []
    for line in report.get("Connections", [])[1:]:
        if line.startswith("     "):
            blocks[-1].append(line.strip())
        elif not line.startswith("  and "):
            blocks.append([line])
    for block in blocks:
        head = _CONNECTION.fullmatch(block[0])
        assert head is not None, block[0]
        yield {
            **head.groupdict(),
            "known": head["arrow"] == "→",
            "transport": "udp" if head["udp"] else "tcp",
        } | _connection(block)


def _connection(block: list[str]) -> Record:
    record: Record = {"tpdu_size": None, "refused": None, "pdu_length": None, "calling_jobs": None, "called_jobs": None}
    record |= {"calling": None, "called": None}
    for line in block[1:-1]:
        if found := re.fullmatch(r"TSAP (.+?)(?: \(.*?\))? → (.+?)(?: \(.*?\))?(?:, TPDU size (\d+))?", line):
            record |= {"calling": _tsap(found[1]), "called": _tsap(found[2]), "tpdu_size": found[3]}
            if place := re.search(r"rack (\d+) slot (\d+)\)(?:, TPDU|$)", line):
                record |= {"rack": place[1], "slot": place[2]}
        elif found := re.fullmatch(
            r"PDU length (\d+)(?: \(requested (\d+)\))?, parallel jobs \(AmQ\): client (\d+), server (\d+)", line
        ):
            record |= {"pdu_length": found[1], "asked": found[2], "client_jobs": found[3], "server_jobs": found[4]}
        elif line.startswith("REFUSED: "):
            record["refused"] = line.removeprefix("REFUSED: ")
    counts, _, end = block[-1].partition("; ")
    record |= {name: 0 for name, _ in _COUNTS}
    for part in counts.split(", "):
        for name, words in _COUNTS:
            if found := re.fullmatch(rf"(\d+) {words}", part):
                record[name] = int(found[1])
    record["unsolicited"] = record["pushes"] + record["one_way"]
    return record | _end(end)


def _tsap(text: str) -> str | None:
    return None if text == "?" else text.strip('"')


def _end(text: str) -> Record:
    """Return how a connection ended, in the terms of other faces: the side, the packet, and the number of open requests."""
    pending = _PENDING.search(text)
    told: Record = {"pending": int(pending[1]) if pending else UNTOLD, "end_frame": None, "role": None}
    if found := _CLOSED.match(text):
        how = {" (COTP disconnect request": "disconnect", " (COTP error TPDU": "error_tpdu"}.get(found["tpdu"] or "")
        frame = found["frame"] if how is None else UNTOLD
        return told | {
            "how": how or {"closed": "fin", "reset": "reset"}[found["deed"]],
            "role": found["role"],
            "end_frame": frame,
        }
    if "still open at the end" in text or "last datagram" in text:
        return told | {"how": "open"}
    if "dropped, too many" in text:
        return told | {"how": "evicted"}
    assert "replaced by a new connection" in text, text
    return told | {"how": "replaced"}


_RULE: Final = re.compile(
    r"  (?P<severity>error|warning|note)  (?P<slug>[\w.]+)(?: \((?P<count>\d+) times\))?: (?P<sentence>.*)"
)
_DETAIL: Final = re.compile(
    r"      (?:connection (?P<connection>\d+), )?(?:packets? (?P<frames>[\d, ]+?)|the capture)(?:: (?P<detail>.*))?"
)


def findings(report: dict[str, list[str]]) -> Iterator[Record]:
    """Yield the report's facts about each slug; ``details`` are its findings in detail, as many as it shows."""
    record: Record = {}
    for line in report.get("Findings", [])[1:]:
        if rule := _RULE.fullmatch(line):
            if record:
                yield record
            record = rule.groupdict() | {"count": int(rule["count"] or 1), "details": [], "techniques": None, "more": 0}
        elif line.startswith("      → "):
            record["advice"] = line.removeprefix("      → ")
        elif line.startswith("      MITRE ATT&CK: "):
            record["techniques"] = re.findall(r"\bT\d{4}(?:\.\d{3})?(?=,| \(|$)", line)
        elif found := re.match(r"      and (\d+) more", line):
            record["more"] = int(found[1])
        elif re.match(r"      \d", line):
            record["facts"] = line.strip()
        elif not line.startswith("      because of it: "):
            detail = _DETAIL.fullmatch(line)
            assert detail is not None, line
            record["details"].append(detail.groupdict())
    if record:
        yield record


def functions(report: dict[str, list[str]]) -> Iterator[Record]:
    """Yield the rows of the table of functions."""
    lines = [line for line in report.get("Transactions", [])[1:] if not re.match(r"  \d+ pairs? (is|are) only", line)]
    if not lines:
        return
    heads = re.split(r"  +", lines[0].strip())
    for line in lines[1:]:
        cells = re.split(r"  +", line.strip())
        yield {head: 0 if cell == "." else cell for head, cell in zip(heads, cells, strict=True)}


def listed(report: dict[str, list[str]]) -> Iterator[Record]:
    """Yield the failed and the slowest transactions that the report lists, each once."""
    seen = set()
    for section in ("Failed", "Slowest"):
        for line in report.get(section, [])[2:]:
            found = re.match(
                rf" +#(?P<number>\d+)  (?P<first>[\d?]+)→(?P<last>[\d?]+) +{_TOOK}  (?P<function>.+?)(?:  |$)", line
            )
            assert found is not None, line
            if found["number"] not in seen:
                seen.add(found["number"])
                record: Record = found.groupdict()
                for name in ("first", "last"):
                    record[name] = None if record[name] == "?" else record[name]
                yield record | {"took": {"-": None, "?": UNTOLD}.get(record["took"], record["took"])}


def kinds(report: dict[str, list[str]]) -> dict[str, dict[str, int]]:
    """Return the number of operations of each kind and result; the report has no separate table of connection setups."""
    names = {said: kind for kind, said in NAMES.items()}
    found: dict[str, dict[str, int]] = {}
    for line in report.get("Operations", [])[1:]:
        name, _, results = re.split(r"  +", line.strip(), maxsplit=2)
        counts = [one.partition(" ") for one in results.split(", ")]
        found[names[name]] = {_RESULTS.get(said, said.lower()): int(number) for number, _, said in counts}
    return found


def totals(report: dict[str, list[str]]) -> Record:
    """Return the report's facts about the capture as a whole."""
    record: Record = {
        "answered": 0,
        "unanswered": 0,
        "open": 0,
        "not_captured": 0,
        "orphans": 0,
        "pushes": 0,
        "one_way": 0,
    }
    record |= {"errors": 0, "likely": 0, "behind": 0}
    patterns = {
        "answered": r"(\d+) answered", "unanswered": r"(\d+) unanswered", "open": r"(\d+) still open at the end",
        "not_captured": r"(\d+) answers? not captured", "orphans": r"(\d+) answers? without request",
        "pushes": r"(\d+) push(?:es)?\b", "one_way": r"(\d+) one-way requests?", "errors": r"(\d+) with errors",
        "likely": r"\((\d+) only likely\)", "behind": r"(\d+) more behind malformed headers",
    }  # fmt: skip
    heading = (report.get("Transactions") or [""])[0]
    for name, pattern in patterns.items():
        if found := re.search(pattern, heading):
            record[name] = int(found[1])
    record["unsolicited"] = record["pushes"] + record["one_way"]
    complete = " ".join(report["Completeness"])
    begin = re.search(rf"  from {_MOMENT}", "\n".join(report[""]))
    record["begin"] = begin["time"] if begin is not None and "earliest to latest" not in report[""][1] else UNTOLD
    packets = re.search(r"(\d+) of (\d+) packets? used", complete)
    gaps = re.search(r"(\d+) gaps? in the TCP streams, (\d+) bytes? missing", complete)
    assert packets is not None
    record |= {"used": int(packets[1]), "packets": int(packets[2])}
    record |= {"gaps": int(gaps[1]), "missing": int(gaps[2])} if gaps else {"gaps": 0, "missing": 0}
    return record
