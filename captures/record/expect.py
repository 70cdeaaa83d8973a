"""The contents of a recording, counted only from tshark's dissection: the ``[expected]`` table of its TOML file.

    python captures/record/expect.py captures/*.pcapng          print the tables
    python captures/record/expect.py --check captures/*.pcapng  compare them with the TOML files, exit code 1 on a difference

tshark neither pairs requests with answers nor counts errors, so this is done here, from its fields, in the simplest way: one
list of open requests for each (TCP stream, side that asks, Job or Userdata, PDU reference), oldest first.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tomllib
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

Tree = dict[str, Any]
Expected = dict[str, Any]

JOB, ACK, ACK_DATA, USERDATA = 1, 2, 3, 7
PUSH, REQUEST, RESPONSE = 0, 4, 8
"""Upper half of the type octet in the parameters of a Userdata PDU, as tshark gives it."""
READ, WRITE = 0x04, 0x05
GOOD = 0xFF
SYN_ACK = 0x12


def listed(value: Any) -> list[Any]:
    """A value as a list: tshark gives one only if a name occurs more than once."""
    if value is None:
        return []
    return value if isinstance(value, list) else [value]


def number(tree: Tree, name: str) -> int | None:
    """A field in either notation, None if it is missing."""
    return int(tree[name], 0) if name in tree else None


def find(tree: Any, name: str) -> Iterator[Any]:
    """Every value of one name, at any depth, in order."""
    if isinstance(tree, list):
        for part in tree:
            yield from find(part, name)
    elif isinstance(tree, dict):
        for key, value in tree.items():
            if key == name:
                yield from listed(value)
            yield from find(value, name)


class Pdu:
    """One S7comm PDU as tshark shows it."""

    def __init__(self, tcp: Tree, tree: Tree) -> None:
        header, parameters = tree["s7comm.header"], tree.get("s7comm.param", {})
        self.stream = tcp["tcp.stream"]
        self.sender = tcp["tcp.srcport"]
        self.receiver = tcp["tcp.dstport"]
        self.rosctr = int(header["s7comm.header.rosctr"])
        self.pdu_ref = int(header["s7comm.header.pduref"])
        self.function = number(parameters, "s7comm.param.func")
        head = number(parameters, "s7comm.param.userdata.head")
        if head is not None:
            self.function = head >> 16  # three octets, the first of which is where a Job has its function
        self.kind = number(parameters, "s7comm.param.userdata.type")
        errors = (
            (header, "s7comm.header.errcls"),
            (header, "s7comm.header.errcod"),
            (parameters, "s7comm.param.errcod"),
        )
        self.refused = any(number(tree, name) for tree, name in errors)
        self.return_codes = [int(value, 0) for value in find(tree.get("s7comm.data", {}), "s7comm.data.returncode")]

    @property
    def asks(self) -> bool:
        """A request."""
        return self.rosctr == JOB or (self.rosctr == USERDATA and self.kind == REQUEST)

    @property
    def pushes(self) -> bool:
        """An unsolicited message."""
        return self.rosctr == USERDATA and self.kind == PUSH

    def key(self) -> tuple[str, str, bool, int]:
        """The key that a request and its answer have in common."""
        asking = self.sender if self.asks else self.receiver
        return self.stream, asking, self.rosctr == USERDATA, self.pdu_ref


def read_packets(path: Path, port: int) -> list[Tree]:
    """The layers of every packet; raises CalledProcessError if tshark fails. ``port`` is taken for TPKT."""
    command = ["tshark", "-n", "-r", str(path), "-d", f"tcp.port=={port},tpkt"]
    command += ["-T", "json", "-J", "tcp s7comm", "--no-duplicate-keys"]
    text = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    return [packet["_source"]["layers"] for packet in json.loads(text)]


def connects(tcp: Tree) -> bool:
    """Whether a packet shows that its connection was established: SYN with ACK, or octets."""
    return int(tcp["tcp.flags"], 0) & SYN_ACK == SYN_ACK or int(tcp["tcp.len"]) > 0


def count_expected(packets: list[Tree]) -> Expected:
    """The ``[expected]`` table of packets as tshark shows them; ``captures/README.md`` explains each number."""
    # A frame may hold several PDUs.
    pdus = [Pdu(layers["tcp"], tree) for layers in packets for tree in listed(layers.get("s7comm"))]
    waiting: dict[tuple[str, str, bool, int], int] = defaultdict(int)
    answered = orphans = 0
    for pdu in pdus:
        if pdu.asks:
            waiting[pdu.key()] += 1
        elif not pdu.pushes:
            if waiting[pdu.key()]:
                waiting[pdu.key()] -= 1
                answered += 1
            else:
                orphans += 1
    functions = Counter(pdu.function for pdu in pdus if pdu.function is not None)
    answers = [pdu for pdu in pdus if pdu.rosctr == ACK_DATA and pdu.function in (READ, WRITE)]
    return {
        "packets": len(packets),
        "connections": len({layers["tcp"]["tcp.stream"] for layers in packets if connects(layers["tcp"])}),
        "s7_pdus": len(pdus),
        "answered": answered,
        "unanswered": sum(waiting.values()),
        "orphan_answers": orphans,
        "unsolicited": sum(pdu.pushes for pdu in pdus),
        "item_errors": sum(code != GOOD for pdu in answers for code in pdu.return_codes),
        "header_errors": sum(pdu.refused for pdu in pdus if not pdu.asks),
        "functions": {f"0x{function:02x}": functions[function] for function in sorted(functions)},
    }


def write_table(expected: Expected) -> str:
    """The table as TOML."""
    lines = ["[expected]"]
    lines += [f"{name} = {value}" for name, value in expected.items() if name != "functions"]
    lines += ["", "[expected.functions]"]
    lines += [f'"{name}" = {value}' for name, value in expected["functions"].items()]
    return "\n".join(lines) + "\n"


def main(arguments: list[str]) -> int:
    """Print the tables or compare them; returns the exit code."""
    check = "--check" in arguments
    differences = 0
    for path in (Path(argument) for argument in arguments if argument != "--check"):
        told = tomllib.loads(path.with_suffix(".toml").read_text())
        counted = count_expected(read_packets(path, told["port"]))
        if not check:
            print(f"# {path.stem}\n{write_table(counted)}")
        elif counted != told["expected"]:
            differences += 1
            print(f"{path.stem}: the file says {told['expected']}, tshark {counted}")
    return 1 if differences else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
