"""Write docs/findings.md from the catalogue: `python scripts/findings_doc.py > docs/findings.md`."""

from __future__ import annotations

from dissect.engine.findings.catalogue import CATALOGUE, EACH, KINDS, REPORTED, SEVERITIES, Rule
from dissect.engine.findings.cause_tables import CAUSES
from dissect.engine.findings.mitre import TECHNIQUES

_OF_KINDS = {
    "capture": "the capture itself and what the analyzer had to leave out",
    "protocol": "TCP, TPKT, COTP and S7 as protocols",
    "negotiation": "what the two sides agreed on, and whether they keep to it",
    "function": "requests and answers",
    "security": "what an intruder would do, and others may have reasons for",
    "operation": "what takes several requests",
}


def document() -> str:
    """Return the page, from the rules alone."""
    lines = [
        "# Findings",
        "",
        "Made from the catalogue (`scripts/findings_doc.py`); a test keeps it so. Slugs are stable. Each finding names",
        "its connection, the packets that show it and what was seen. Counters are exact; at most 100 findings of a slug",
        "are detailed for one connection, and 1000 in all.",
        "",
        "The kind of a rule says what it is about:",
        "",
        *[f"- {kind}: {_OF_KINDS[kind]}" for kind in KINDS],
        "",
        "A request whose answer is, or may be, in a gap of the capture is no finding: its `reason` is `hole`, and `certainty`",
        "tells the two apart. Where the capture does not show for sure which request an answer belongs to, the pair has the",
        "`certainty` `likely`: it is not judged slow, nor is its answer said not to fit the request ([json.md](json.md)).",
    ]
    for severity in SEVERITIES:
        rules = [rule for rule in CATALOGUE.values() if rule.severity == severity]
        lines += [
            "",
            f"## {severity}",
            "",
            "| slug | kind | what | what to do | MITRE ATT&CK |",
            "|---|---|---|---|---|",
        ]
        lines += [
            f"| `{rule.slug}` | {rule.kind} | {rule.sentence} | {rule.advice} | {_techniques(rule)} |" for rule in rules
        ]
    lines += [
        "",
        "## How often a rule reports",
        "",
        "Most rules report each event. What is said of events is counted from all of them, also from those that are not",
        "reported or not shown in detail: `finding_facts` in JSON, the table `finding_counts`, and `27 writes on 1 connection,",
        "17:50:20 to 19:58:01` in the text. Others report",
        "",
        *[
            f"- {reported}: {', '.join([f'`{rule.slug}`' for rule in CATALOGUE.values() if rule.reported == reported])}"
            for reported in REPORTED
            if reported != EACH
        ],
        "",
        "Of what is reported once per distinct request, nobody counts how often the request is sent.",
        "",
        "## Causes",
        "",
        "A finding may explain others: a malformed request is refused, and nobody is probing anything. Each row is a cause,",
        'and what it explains when it is to blame. The text names with each cause what it explains ("because of it");',
        "in JSON that is listed with `explained_by`, the number of its cause, and counted in `findings_explained`. It counts",
        "neither for `--fail-on` nor for alerts, and starts no recording. The severity of a cause is never below that of its",
        "consequences.",
        "Acts are never explained away: stop, start, program, writes, memory and force. Nothing is explained by what may",
        "only be missing from the capture.",
        "",
        "The last three show themselves only in what stays unanswered. While there are signs of one, findings that it would",
        "explain wait for the end of the connection, for an answer that refutes it, or for five seconds.",
        "",
        "| cause | explains | when |",
        "|---|---|---|",
    ]
    lines += [
        f"| `{cause.slug}` | {', '.join([f'`{slug}`' for slug in cause.consequences])} | {cause.when} |"
        for cause in CAUSES
    ]
    lines += [
        "",
        "Known bugs of clients and servers that findings name: [known-bugs.md](known-bugs.md).",
        "",
        "## MITRE ATT&CK for ICS",
        "",
        "The techniques that findings point to. A finding is no proof of an attack: engineers stop, load and read out PLCs",
        "as well. Release 19 renumbered nine techniques as sub-techniques, so both ids are given.",
        "",
        "| technique | v18 | v19 | source |",
        "|---|---|---|---|",
    ]
    lines += [f"| {one.name} | {one.v18} | {one.v19} | {one.source} |" for one in TECHNIQUES.values()]
    return "\n".join(lines) + "\n"


def _techniques(rule: Rule) -> str:
    return ", ".join([str(technique) for technique in rule.techniques])


if __name__ == "__main__":
    print(document(), end="")
