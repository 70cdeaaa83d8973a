"""The contents of a golden, read from its text only by patterns, with those of its remarks for which tshark has fields."""

from __future__ import annotations

import json
import re
import struct
from typing import Final

_FORMS: Final = {"READ", "WRITE", "SETUP"}
_REMARK: Final = re.compile(r" {4}# (.*)")
#: Facts in remarks for which tshark has fields, by the beginning of the function.
_FACTS: Final = [
    (re.compile(function), re.compile(remark), said)
    for function, remark, said in [
        ("CPU functions: read SZL", r"SZL (0x[0-9a-f]{4}).*?(?:, index (0x[0-9a-f]{4}))?", "SZL {0} index {1}"),
        ("Request|Download|Start|PI service|block functions", r"(?:block )?([A-Z]\w+ [0-9]+, (?:active|passive).*)", "{0}"),
        ("block functions: get", r"block \w+ ([0-9]+), .*", "block {0}"),
        ("PI service|PLC stop", r"(_?[A-Z][A-Z_0-9]+)(?:: .*)?", "service {0}"),
        ("Request download", r"([0-9]+ bytes, [0-9]+ of them MC7 code)", "{0}"),
        ("Start upload|Download block|Upload|PBC.*BSEND", r"([0-9]+ bytes)", "{0}"),
        ("Download block|Upload", r"(more to come)", "{0}"),
        ("block functions: list blocks$", r"([0-9]+ \w+)", "{0}"),
        ("block functions: list blocks of", r"([0-9]+) \(.*\)", "block {0}"),
        ("block functions: list blocks of", r"(\w+)", "{0}"),
        ("time functions", r"(DT#\S+)", "{0}"),
        ("PBC.*BSEND", r"(R_ID 0x[0-9a-f]{8})", "{0}"),
    ]
]  # fmt: skip
#: Indexes of system status lists for which a remark has a name instead of the number.
_INDEXES: Final = {
    ("SZL 0x0111", "basic hardware"): "0x0006",
    ("SZL 0x0131", "general"): "0x0001",
    ("SZL 0x0132", "protection"): "0x0004",
    ("SZL 0x0232", "protection"): "0x0004",
}


class Said:
    """A transaction: its number, and its lines as `tests.testing.golden.tshark_lines.deal_lines` writes them."""

    def __init__(self, number: int, lines: list[str]) -> None:
        self.number = number
        self.lines = lines
        head = lines[0].partition(" ")[2]
        halves = [line for line in lines[1:] if re.match(r"(request|answer|says) \S", line)]
        halves = [line for line in halves if not line.startswith("answer without")]
        self.by_form = head in _FORMS
        self.plain = self.by_form and not any(line.startswith("answer ") for line in halves)
        self.whole = frozenset(line.partition(" ")[0] for line in halves if line.split(" ")[1] == "octets")


class SaidLink:
    """A connection: its number, its facts, and the transactions on it."""

    def __init__(self, number: int) -> None:
        self.number = number
        self.lines: list[str] = []
        self.deals: list[Said] = []


def read_said(text: str) -> list[SaidLink]:
    """Return the contents of a golden."""
    links: list[SaidLink] = []
    for block in text.split("\n\n")[1:]:
        first, *rest = re.sub(r"\n {8}(?=\S)", " ", block.rstrip("\n")).split("\n")
        if found := re.fullmatch(r"connection ([0-9]+)", first):
            link = SaidLink(int(found[1]))
            for line in [re.sub(r"  # .*", "", line).strip() for line in rest]:
                # tshark has no dissector for other protocols and their carriers.
                if line == "protocol s7comm" or not line.startswith(("protocol ", "carrier ")):
                    link.lines.append(line)
            links.append(link)
        else:
            number, _, head = first.partition(" ")
            links[-1].deals.append(Said(int(number), [head, *_lines(head.partition(" ")[2], rest)]))
    return links


def _lines(head: str, rest: list[str]) -> list[str]:
    lines = []
    for line in rest:
        if found := _REMARK.fullmatch(line):
            fact = _fact(head, found[1])
            lines += [f"# {fact}"] if fact else []
        elif re.match(r"  (?:  )?[^ #]", line) and not line.startswith(
            ("  scd ", "  job of ", "  likely: ")
        ):  # tshark does not show this
            said = re.sub(r"  # .*", "", line).strip().removesuffix(", perhaps")
            said = re.sub(r'= (".*")$', _text, re.sub(r'= (".*") (?=refused|as )', _text, said))
            lines.append(re.sub(r"(L?REAL)( x[0-9]+)? = (\[.*\]|[^\s<]\S*)", _octets, said))
    return lines


def _fact(head: str, remark: str) -> str:
    for words, number in _INDEXES.items():
        remark = re.sub(f"({words[0]} .*), {words[1]}$", rf"\1, index {number}", remark)
    for function, pattern, said in _FACTS:
        if function.match(head) and (found := pattern.fullmatch(remark)):
            return said.format(*[group or "0x0000" for group in found.groups()])
    return ""


def _text(found: re.Match[str]) -> str:
    octets = json.loads(found[1]).encode("latin-1")
    return f"= chars {octets.hex()}{' ' if found[0].endswith(' ') else ''}"


def _octets(found: re.Match[str]) -> str:
    """Return floating-point numbers as octets, because there is more than one way to write them."""
    form = ">d" if found[1] == "LREAL" else ">f"
    numbers = [float(text) for text in found[3].strip("[]").split(", ")]
    return f"{found[1]}{found[2] or ''} = {b''.join([struct.pack(form, number) for number in numbers]).hex()}"
