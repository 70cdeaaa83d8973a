"""The facts of a finding."""

from __future__ import annotations

from typing import Final

from dissect.engine.findings.catalogue import KINDS, SEVERITIES
from dissect.engine.findings.reporter import Finding
from dissect.meaning.facts.fact import CODE, COUNT, FILE, FRAMES, JSON, SERIAL, TEXT, TIME, WORD, WORDS, Fact, by_name

_ROWS: Final[tuple[Fact[Finding], ...]] = (
    Fact("number", SERIAL, "Number of the finding: the findings of a run are counted from 1 in the order in which they are"
         " reported, also those of what was read that a selection leaves out. With --separate the files are counted on from one"
         " to the next. `explained_by`, `cut --finding` and the column `finding` of tables are these numbers.",
         lambda of: int(of.number) or None, column="finding", null=True),
    Fact("slug", WORD, "The stable name of the rule.", lambda of: of.rule.slug,
         shape={"type": "string", "pattern": r"^[a-z0-9]+\.[a-z0-9_]+$"}),
    Fact("severity", CODE, "Severity of the rule.", lambda of: of.rule.severity, codes=tuple(SEVERITIES)),
    Fact("kind", CODE, "Kind of the rule.", lambda of: of.rule.kind, codes=tuple(KINDS)),
    Fact("connection", COUNT, "Number of the connection, null for the capture as a whole.",
         lambda of: int(of.connection) or None, null=True, least=1),
    Fact("frames", FRAMES, "Packets that show it, each within its file.", lambda of: [int(frame) for frame in of.frames]),
    Fact("time", TIME, "Time of the last of `frames`, null when there is none.",
         lambda of: int(of.time_ns) or None, column="ts", null=True),
    Fact("sentence", WORD, "The sentence of the rule, always the same.", lambda of: of.rule.sentence),
    Fact("detail", TEXT, "The observation, for a person; may be empty, and its wording may change.", lambda of: of.detail),
    Fact("advice", WORD, "Advice on what to do.", lambda of: of.rule.advice),
    Fact("techniques", JSON, "Techniques of MITRE ATT&CK for ICS that it may be part of; empty for most rules.",
         lambda of: [technique.as_dict() for technique in of.rule.techniques],
         shape={"type": "array", "items": {"$ref": "#/$defs/technique"}}),
    Fact("explained_by", SERIAL, "`number` of the finding that explains this one (docs/findings.md, causes); null when nothing"
         " explains it. Also null when its cause was only counted; then `because_of` names the cause.",
         lambda of: int(of.explained_by) or None, null=True),
    Fact("because_of", WORD, "Slug of the finding that explains this one, null when nothing explains it.",
         lambda of: of.because or None, null=True),
    # ---- what JSON has inside of an object, or not at all
    Fact("file", FILE, "Capture file of the first packet.", lambda of: int(of.frames[0]) if of.frames else 0, key=""),
    Fact("client_host", WORD, "Address of the client, also where it is about no connection.", None, key=""),
    Fact("server_host", WORD, "Address of the server, in the same way.", None, key=""),
    Fact("techniques_v18", WORDS, "MITRE ATT&CK for ICS technique ids, v18.",
         lambda of: [technique.v18 for technique in of.rule.techniques], key="", column="techniques"),
    Fact("techniques_v19", WORDS, "The same in v19.", lambda of: [technique.v19 for technique in of.rule.techniques], key=""),
    Fact("technique_names", WORDS, "Their names.", lambda of: [technique.name for technique in of.rule.techniques], key=""),
)  # fmt: skip

#: The facts of a finding by their names, in the order of their keys in JSON.
FINDING: Final[dict[str, Fact[Finding]]] = by_name(_ROWS)
