"""The goldens in captures/golden: they are what the captures give, and every item in them is what tshark says of it."""

from __future__ import annotations

import re
import struct
import tomllib
from collections import defaultdict
from typing import Final

import pytest

from captures.record.expect import JOB, READ, WRITE, Pdu, Tree, listed, read_packets
from dissect.golden import golden_text, read_session
from tests.golden.support import RECORDED, ROOT

FOLDER: Final = ROOT / "captures"
GOLDEN: Final = FOLDER / "golden"

# ---- what tshark says, written down as a golden writes it, by nothing but these tables -------------------------------

_LETTERS: Final = {0x80: "P", 0x81: "I", 0x82: "Q", 0x83: "M"}
#: Type, letter of its width, how one element is packed, data transport size of the answer, by the number of the request.
_TYPES: Final = {
    1: ("BIT", "X", "?", 3),
    2: ("BYTE", "B", "B", 4),
    3: ("CHAR", "B", "", 9),
    4: ("WORD", "W", ">H", 4),
    5: ("INT", "W", ">h", 5),
    6: ("DWORD", "D", ">I", 4),
    7: ("DINT", "D", ">i", 5),
    8: ("REAL", "D", ">f", 7),
    28: ("COUNTER", "", "", 9),
    29: ("TIMER", "", "", 9),
}
_SIZES: Final = {3: "BIT", 4: "BYTE/WORD/DWORD", 5: "INTEGER", 7: "REAL", 9: "OCTET_STRING"}


def item_line(item: Tree) -> str:
    """Return the name of a request item."""
    size, area = int(item["s7comm.param.item.transp_size"]), int(item["s7comm.param.item.area"], 0)
    name, width, *_ = _TYPES[size]
    place = item.get("s7comm.param.item.address_tree", {})
    db = int(item["s7comm.param.item.db"])
    octet = place.get("s7comm.param.item.address.byte", "")
    bit = f".{place['s7comm.param.item.address.bit']}" if name == "BIT" else ""
    if area == 0x84:
        text = f"DB{db}.DB{width}{octet}{bit} {name}"
    elif area in {0x1C, 0x1D}:
        text = f"{'C' if area == 0x1C else 'T'}{int(item['s7comm.param.item.address'], 0)} {name}"
    else:
        text = f"{_LETTERS[area]}{'' if width == 'X' else width}{octet}{bit} {name}"
    count = int(item["s7comm.param.item.length"])
    return text + (f" x{count}" if count != 1 else "") + (f" db {db}" if db and area != 0x84 else "")


def value_text(item: Tree, data: bytes) -> str:
    """Return the value of an item from its octets."""
    name, _, form, _ = _TYPES[int(item["s7comm.param.item.transp_size"])]
    if name == "CHAR":
        return "chars"
    if name == "REAL":
        return data.hex()
    if name == "BIT" and data not in {b"\0", b"\1"}:
        return f"<{data.hex(' ')}>"
    if form and data and not (name == "BYTE" and len(data) > 1) and len(data) % struct.calcsize(form) == 0:
        if len(data) == struct.calcsize(form) * int(item["s7comm.param.item.length"]):
            found = [value for (value,) in struct.iter_unpack(form, data)]
            texts = [str(value).lower() if name == "BIT" else repr(value) for value in found]
            return texts[0] if len(texts) == 1 else f"[{', '.join(texts)}]"
    return f"<{data.hex(' ')}>"


def answered_line(item: Tree, told: Tree | None, written: Tree | None) -> str:
    """Return a line of a golden: the item, its value, and what became of it."""
    text = item_line(item)
    holder = written if written is not None else told
    good = told is None or int(told["s7comm.data.returncode"], 0) == 0xFF
    if holder is not None and (good or written is not None):
        data = bytes.fromhex(holder.get("s7comm.resp.data", "").replace(":", ""))
        size = int(holder["s7comm.data.transportsize"], 0)
        text += f" = {value_text(item, data)}"
        if size != _TYPES[int(item["s7comm.param.item.transp_size"])][3]:
            text += f" as {_SIZES[size]}"
    if not good and told is not None:
        text += f" refused {told['s7comm.data.returncode']}"
    return text


class Asked:
    """A request and its answer as tshark shows them."""

    def __init__(self, function: int, items: list[Tree], written: list[Tree]) -> None:
        self.function = function
        self.items = items
        self.written = written
        self.told: list[Tree] | None = None

    def lines(self) -> list[str]:
        """Return the block that a golden has for it."""
        lines = ["READ" if self.function == READ else "WRITE"]
        for index, item in enumerate(self.items):
            told = self.told[index] if self.told is not None else None
            lines.append(answered_line(item, told, self.written[index] if self.written else None))
        return lines


def from_tshark(name: str) -> list[list[list[str]]]:
    """Return the reads and writes of every connection, sorted by what they say."""
    path = FOLDER / f"{name}.pcapng"
    port = tomllib.loads(path.with_suffix(".toml").read_text(encoding="utf-8"))["port"]
    streams: dict[str, list[Asked]] = defaultdict(list)
    waiting: dict[tuple[str, str, bool, int], list[Asked]] = defaultdict(list)
    for layers in read_packets(path, port):
        for tree in listed(layers.get("s7comm")):
            pdu = Pdu(layers["tcp"], tree)
            items = listed(tree.get("s7comm.param", {}).get("s7comm.param.item"))
            data = listed(tree.get("s7comm.data", {}).get("s7comm.data.item"))
            if pdu.rosctr == JOB and pdu.function in {READ, WRITE} and items:
                asked = Asked(pdu.function, items, data if pdu.function == WRITE else [])
                streams[pdu.stream].append(asked)
                waiting[pdu.key()].append(asked)
            elif not pdu.asks and waiting[pdu.key()]:
                asked = waiting[pdu.key()].pop(0)
                if len(data) == len(asked.items) and not pdu.refused:
                    asked.told = data
    return sorted([[asked.lines() for asked in found] for found in streams.values()])


# ---- what the golden says, read from its text ------------------------------------------------------------------------


def from_golden(text: str) -> list[list[list[str]]]:
    """Return the reads and writes of every connection in a golden, sorted by what they say."""
    joined = re.sub(r"\n {8}(?=\S)", " ", re.sub(r"  # .*", "", text))
    connections: list[list[list[str]]] = []
    block: list[str] | None = None
    for line in joined.split("\n"):
        if line.startswith("connection "):
            connections.append([])
            block = None
        elif found := re.fullmatch(r"[0-9]+ (?:client|server) (.*)", line):
            block = [found[1]] if found[1] in {"READ", "WRITE"} else None
            if block is not None:
                connections[-1].append(block)
        elif (
            block is not None
            and line.startswith("  ")
            and line[2] != " "
            and not line.startswith(("  no answer", "  answer "))
        ):
            # What stands behind the code of a refused item tshark takes from the item before it (docs/oracle.md).
            said = re.sub(r" head <[^>]*>", "", re.sub(r'= "[^"]*"', "= chars", line[2:]))
            block.append(re.sub(r"(?<= REAL)(.*) = (\[.*\]|\S+)", _singles, said))
    return sorted([found for found in connections if found])


def _singles(found: re.Match[str]) -> str:
    """Return numbers of single precision as octets, because there is more than one way to write them."""
    numbers = [float(text) for text in found[2].strip("[]").split(", ")]
    return f"{found[1]} = {b''.join([struct.pack('>f', number) for number in numbers]).hex()}"


@pytest.mark.parametrize("name", RECORDED)
def test_every_item_is_what_tshark_says(name: str) -> None:
    assert from_golden((GOLDEN / f"{name}.s7.txt").read_text(encoding="utf-8")) == from_tshark(name)


@pytest.mark.parametrize("name", RECORDED)
def test_goldens_are_what_their_captures_give(name: str) -> None:
    written = (GOLDEN / f"{name}.s7.txt").read_bytes()
    assert golden_text(read_session(FOLDER / f"{name}.pcapng")).encode() == written, (
        "python -m captures.golden writes it anew"
    )


def test_there_is_a_golden_for_each_recording_and_none_besides() -> None:
    assert sorted(path.name for path in GOLDEN.glob("*.s7.txt")) == sorted([f"{name}.s7.txt" for name in RECORDED])
