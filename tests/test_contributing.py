"""The recipes of CONTRIBUTING.md, each carried out once on a copy of the tree: the files it names are those it takes."""

from __future__ import annotations

import json
import os
import re
import shutil
import struct
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar, Final

import pytest

import dissect
from dissect.engine.transactions.transaction import Transaction

ROOT: Final = Path(__file__).resolve().parent.parent
GUIDE: Final = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
#: What a recipe works with.
COPIED: Final = ("dissect", "tests", "docs", "scripts", "captures")
#: How many files a protocol may cost outside its room.
MOST: Final = 8


def listed(recipe: str) -> set[str]:
    """Return the files that the list of a recipe names."""
    section = GUIDE[GUIDE.index(f"### {recipe}\n") :]
    section = re.split(r"\n##+ ", section[4:])[0]
    return set(re.findall(r"^- `([^`]+)`", section, re.MULTILINE))


#: Runs scripts and modules in one process, which imports once what they need; each prints to a file, or to nowhere for ``-``.
RUNNING: Final = """
import contextlib, io, runpy, sys
from pathlib import Path
def run(script, out="-", *arguments):
    said = io.TextIOWrapper(io.BytesIO(), encoding="utf-8")
    standing, sys.argv = sys.argv, [script, *arguments]
    with contextlib.redirect_stdout(said):
        try:
            (runpy.run_path if script.endswith(".py") else runpy.run_module)(script, run_name="__main__")
        except SystemExit as end:
            assert not end.code, end.code
    sys.argv = standing
    said.flush()
    printed = said.buffer.getvalue().decode("utf-8")
    if out != "-":
        Path(out).write_text(printed, encoding="utf-8")
    return printed
"""


class Tree:
    """A copy of the tree that may be changed."""

    #: The copy before, whose bytecode serves for each file that was not changed there.
    earlier: ClassVar[Path | None] = None

    def __init__(self, root: Path) -> None:
        self.root = root
        for name in COPIED:
            shutil.copytree(ROOT / name, root / name, ignore=shutil.ignore_patterns("__pycache__", "*.so"))
        for name in ("benchmarks", "pyproject.toml", "README.md", "CONTRIBUTING.md"):
            (root / name).symlink_to(ROOT / name)
        self._before = {path: self._state(path) for path in self._files()}
        if Tree.earlier is not None:
            for folder in Tree.earlier.rglob("__pycache__"):
                shutil.copytree(folder, root / folder.relative_to(Tree.earlier), dirs_exist_ok=True)
        Tree.earlier = root

    def _files(self) -> Iterator[Path]:
        for name in COPIED:
            for path in (self.root / name).rglob("*"):
                if path.is_file() and path.suffix != ".pyc" and ".hypothesis" not in path.parts:
                    yield path

    @staticmethod
    def _state(path: Path) -> tuple[int, int]:
        status = path.stat()
        return status.st_mtime_ns, status.st_size

    def touched(self) -> set[str]:
        """Return the files that were added or changed."""
        written = {path for path in self._files() if self._before.get(path) != self._state(path)}
        names = {path: path.relative_to(self.root).as_posix() for path in written}
        return {
            name
            for path, name in names.items()
            if path not in self._before or path.read_bytes() != (ROOT / name).read_bytes()
        }

    def write(self, name: str, text: str) -> None:
        path = self.root / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")

    def replace(self, name: str, old: str, new: str) -> None:
        path = self.root / name
        text = path.read_text(encoding="utf-8")
        assert text.count(old) == 1, f"{name} has {text.count(old)} times: {old}"
        path.write_text(text.replace(old, new), encoding="utf-8")

    def python(self, *arguments: str) -> str:
        """Run Python on the copy, interpreted, and return what it printed."""
        environment = {key: value for key, value in os.environ.items() if not key.startswith(("S7DISSECT_", "PYTEST_"))}
        environment |= {"PYTHONPATH": str(self.root), "PYTHONSAFEPATH": "1"}
        environment.pop("PYTHONDONTWRITEBYTECODE", None)  # the next process would compile all that it imports again
        ran = subprocess.run(
            [sys.executable, *arguments],
            cwd=self.root,
            env=environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            check=False,
        )
        assert ran.returncode == 0, ran.stdout + ran.stderr
        return ran.stdout


@pytest.fixture
def tree(tmp_path: Path) -> Tree:
    return Tree(tmp_path / "tree")


def test_every_file_of_the_recipes_is_there() -> None:
    recipes = re.findall(r"^### (To add .*)$", GUIDE, re.MULTILINE)
    assert len(recipes) >= 4
    for recipe in recipes:
        assert listed(recipe)
        for name in listed(recipe):
            assert "NAME" in name or (ROOT / name).is_file(), f"{recipe}: {name}"


# ---- a finding ------------------------------------------------------------------------------------------------------

FINDING_ROW: Final = """    ("transaction.all_refused", NOTE, FUNCTION, "Every item of a request was refused.",
     "Compare the data blocks of the project with those in the PLC.", ""),
"""
FINDING_RULE: Final = """    slug = "transaction.item_error"
"""
FINDING_RULE_MADE: Final = """    if transaction.s7_results and all(result.refused for result in transaction.s7_results):
        _note(reporter, "transaction.all_refused", transaction, transaction.parameters.subject)
    slug = "transaction.item_error"
"""
FINDING_TEST: Final = """

@speaks("transaction.all_refused")
def all_refused(talk: Talk) -> None:
    talk.open()
    talk.ask(read(1, dbw(1, 0), dbw(1, 2)))
    talk.tell(ack_data(1, b"\\x04\\x02", refused(0x0A) * 2))


@silent("transaction.all_refused")
def one_of_two_refused(talk: Talk) -> None:
    talk.open()
    talk.ask(read(1, dbw(1, 0), dbw(1, 2)))
    talk.tell(ack_data(1, b"\\x04\\x02", refused(0x0A) + good(4, b"\\0\\1")))


@speaks("transaction.item_error")
"""

#: The tests of the copy that such a change concerns, and what a capture gives.
FINDING_TRIED: Final = f"""
{RUNNING}
import json
run("scripts/findings_doc.py", "docs/findings.md")
import dissect
from tests.engine.findings import test_catalogue as catalogue
catalogue.test_words()
catalogue.test_what_the_code_notes_is_the_catalogue()
for scenarios, spoken in ((catalogue.SPEAKS, True), (catalogue.SILENT, False)):
    talk = catalogue.Talk()
    scenarios["transaction.all_refused"](talk)
    talk.pipeline.finish()
    assert ("transaction.all_refused" in talk.slugs()) is spoken
found = dissect.analyze(sys.argv[1]).as_dict()["findings"]
print(json.dumps({{slug: count for slug, count in found.items() if slug == "transaction.all_refused"}}))
"""


def test_to_add_a_finding(tree: Tree) -> None:
    row = '    ("transaction.item_error", '
    tree.replace("dissect/engine/findings/catalogue.py", row, FINDING_ROW + row)
    tree.replace("dissect/engine/findings/transaction_rules.py", FINDING_RULE, FINDING_RULE_MADE)
    tree.replace("tests/engine/findings/test_catalogue.py", '\n\n@speaks("transaction.item_error")\n', FINDING_TEST)
    told = json.loads(tree.python("-c", FINDING_TRIED, "captures/item-errors.pcapng"))
    assert tree.touched() == listed("To add a finding")
    refused = [
        event
        for event in dissect.open(ROOT / "captures/item-errors.pcapng")
        if isinstance(event, Transaction) and event.s7_results and all(result.refused for result in event.s7_results)
    ]
    assert told == {"transaction.all_refused": len(refused)}
    assert len(refused) > 2


# ---- a userdata subfunction -----------------------------------------------------------------------------------------

LAST_CLOCK: Final = """            (0x04, "set clock (second form)", "Request/response.", CLOCK),
"""
QUALITY_NAME: Final = """            (0x05, "read clock quality", "Request/response.", READ),
"""
QUALITY_LAYOUT: Final = """
#: How good the clock is.
CLOCK_QUALITY: Final = Layout(
    "clock quality",
    "made for a test",
    [Field("synchronised", 1, "1 when the clock is synchronised.")],
)


def parse_quality(cursor: Cursor, head: UserdataHead) -> None:
    \"\"\"Cut the payload of a read of the clock's quality: one byte in the response.\"\"\"
    if head.type == RESPONSE:
        part = cursor.take(CLOCK_QUALITY)
        if part is not None:
            part.note = "synchronised" if part.number("synchronised") else "not synchronised"


def parse_clock("""
QUALITY_ROW: Final = """    (GROUP_TIME, READ_QUALITY): clock.parse_quality,
"""
SET_CLOCK_ROW: Final = """    (GROUP_TIME, SET_CLOCK_SECOND): clock.parse_clock,
"""
QUALITY_PDUS: Final = """    (ASKED, 5, ""), (TOLD, 5, "01"),
"""
SET_CLOCK_PDUS: Final = """    (ASKED, 4, "0019" + TIME), (TOLD, 4, ""),
"""
QUALITY_CLASS: Final = """        Row("S7_ClockQuality", clock.CLOCK_QUALITY, "How good the clock is."),
"""
QUALITY_REASON: Final = """    told[USERDATA, userdata_name(7, 5, RESPONSE), COMPARED] = "Wireshark does not know it"
"""

#: The tests of the copy that such a change concerns, and the notes of the new response.
SUBFUNCTION_TRIED: Final = f"""
{RUNNING}
import functools, json
run("captures.craft", "-", "coverage-userdata")
run("scripts/layers_stub.py", "dissect/layers/part_classes.pyi")
run("scripts/layers_stub.py", "dissect/layers/__init__.pyi", "package")
run("scripts/layers_doc.py", "docs/layers-parts.md")
# The page and its tests are made of the same look at all captures.
from scripts import coverage_doc
coverage_doc.census = functools.cache(coverage_doc.census)
said = io.StringIO()
with contextlib.redirect_stdout(said):
    assert not coverage_doc.main([])
coverage_doc.PAGE.write_text(said.getvalue(), encoding="utf-8")
import dissect
from dissect.engine.transactions.transaction import Transaction
from tests import test_coverage
from tests.layers import test_parts
rows = test_coverage.census(None)
test_coverage.test_the_page_is_what_the_captures_of_this_repository_say(rows)
assert test_coverage.faults(rows) == []
test_parts.test_each_structure_has_a_class_of_its_own()
assert "    \\"S7_ClockQuality\\"," in Path("dissect/layers/__init__.pyi").read_text(encoding="utf-8").splitlines()
events = dissect.open("captures/crafted/coverage-userdata.pcapng")
transactions = [event for event in events if isinstance(event, Transaction)]
found = [event for event in transactions if event.function_name.endswith("read clock quality")]
print(json.dumps([[event.outcome, event.response.body.notes] for event in found]))
"""


def test_to_add_a_userdata_subfunction(tree: Tree) -> None:
    tree.replace("dissect/protocols/s7/tables.py", LAST_CLOCK, LAST_CLOCK + QUALITY_NAME)
    number = "SET_CLOCK_SECOND: Final = 4\n"
    tree.replace("dissect/protocols/s7/tables.py", number, number + "READ_QUALITY: Final = 5\n")
    tree.replace(
        "dissect/protocols/s7/bodies.py", "    SET_CLOCK_SECOND,\n", "    READ_QUALITY,\n    SET_CLOCK_SECOND,\n"
    )
    tree.replace("dissect/protocols/s7/clock.py", "\n\ndef parse_clock(", QUALITY_LAYOUT)
    tree.replace("dissect/protocols/s7/bodies.py", SET_CLOCK_ROW, SET_CLOCK_ROW + QUALITY_ROW)
    tree.replace("captures/craft/coverage_userdata.py", SET_CLOCK_PDUS, SET_CLOCK_PDUS + QUALITY_PDUS)
    clock_class = '        Row("S7_Clock", '
    tree.replace("dissect/layers/part_tables.py", clock_class, QUALITY_CLASS + clock_class)
    last = "    for partial in _PLAIN_LISTS:\n"
    tree.replace("scripts/coverage_doc.py", last, QUALITY_REASON + last)
    assert json.loads(tree.python("-c", SUBFUNCTION_TRIED)) == [["answered", ["synchronised"]]]
    assert tree.touched() == listed("To add a userdata subfunction")


# ---- a source of packets --------------------------------------------------------------------------------------------

READER: Final = '''"""Plain captures: a mark of eight bytes, then for each packet its time in seconds, its size and itself."""

from __future__ import annotations

import struct
from typing import Final

from dissect.packets.source.packet import PacketSink
from dissect.packets.source.pcap import LINKTYPE_ETHERNET, MAX_PACKET, ChunkReader, OctetSource

PLAIN_MAGIC: Final = b"PLAINCAP"
_RECORD: Final = struct.Struct(">II")


class PlainReader(ChunkReader):
    """A plain capture. ``head`` begins with `PLAIN_MAGIC`."""

    def __init__(self, source: OctetSource, head: bytes) -> None:
        super().__init__(source, head)
        self._pos = len(PLAIN_MAGIC)
        self._need = _RECORD.size

    def step(self, sink: PacketSink) -> bool:
        """Read the next packet and deliver it to ``sink``; False when there is nothing more to read."""
        if self._done:
            return False
        if not self._fill(_RECORD.size):
            self._finish("inside the head of a packet")
            return False
        seconds, size = _RECORD.unpack_from(self._buf, self._pos)
        if size > MAX_PACKET:
            self._stop(self._pos, f"a record claims a packet of {size} bytes")
            return False
        if not self._fill(_RECORD.size + size):
            self._finish("inside a packet")
            return False
        start = self._pos + _RECORD.size
        self._pos = start + size
        self.packets += 1
        sink.frame(seconds * 1_000_000_000, self._buf, start, start + size, size, LINKTYPE_ETHERNET)
        return True
'''
PCAP_FOUND: Final = """    if head[:4] in PCAP_MAGICS:
"""
PLAIN_FOUND: Final = """    if head.startswith(PLAIN_MAGIC):
        return PlainReader(source, head)
"""
READER_TEST: Final = '''from __future__ import annotations

from pathlib import Path

import pytest

from dissect.packets.source.files import open_capture
from dissect.packets.source.packet import PacketSink
from dissect.packets.source.plain import PLAIN_MAGIC, PlainReader

PACKETS = (b"one", b"", b"three")
WHOLE = PLAIN_MAGIC + b"".join(bytes((0, 0, 0, 7, 0, 0, 0, len(packet))) + packet for packet in PACKETS)


class Found(PacketSink):
    def __init__(self) -> None:
        self.packets: list[tuple[int, bytes]] = []

    def frame(self, time_ns: int, buf: bytes, start: int, end: int, wire_length: int, link_type: int) -> None:
        assert (wire_length, link_type) == (end - start, 1)
        self.packets.append((time_ns, buf[start:end]))


class Dripping:
    """A byte at a time."""

    damage = ""

    def __init__(self, octets: bytes) -> None:
        self.left = octets

    def read(self, size: int) -> bytes:
        piece, self.left = self.left[:1], self.left[1:]
        return piece

    def close(self) -> None:
        self.left = b""


def read(reader: object) -> list[tuple[int, bytes]]:
    found = Found()
    while reader.step(found):  # type: ignore[attr-defined]
        pass
    return found.packets


@pytest.mark.parametrize("size", range(len(PLAIN_MAGIC), len(WHOLE) + 1))
def test_whole_and_cut_off_at_each_place(size: int, tmp_path: Path) -> None:
    path = tmp_path / "capture"
    path.write_bytes(WHOLE[:size])
    reader = open_capture(path)
    assert isinstance(reader, PlainReader)
    expected = [(7_000_000_000, packet) for packet in PACKETS]
    there = [end for end in (19, 27, 40) if end <= size]
    assert read(reader) == expected[: len(there)]
    assert bool(reader.damage) == (size not in {8, *there})


def test_byte_by_byte() -> None:
    reader = PlainReader(Dripping(WHOLE[len(PLAIN_MAGIC) :]), PLAIN_MAGIC)
    assert [packet for _, packet in read(reader)] == list(PACKETS)
    assert not reader.damage
'''

#: A capture of the repository, written anew in that form, and what is read of it.
SOURCE_TRIED: Final = """
import json, struct, sys
import dissect
from dissect.packets.source.files import open_capture
from dissect.packets.source.packet import PacketSink
class Copy(PacketSink):
    def frame(self, time_ns, buf, start, end, wire_length, link_type):
        made.write(struct.pack(">II", time_ns // 1_000_000_000, end - start) + buf[start:end])
with open(sys.argv[2], "wb") as made:
    made.write(b"PLAINCAP")
    reader = open_capture(sys.argv[1])
    while reader.step(Copy()):
        pass
print(json.dumps([dissect.analyze(name).as_dict()["s7"]["pdus"] for name in sys.argv[1:]]))
"""


def test_to_add_a_source_of_packets(tree: Tree, tmp_path: Path) -> None:
    tree.write("dissect/packets/source/plain.py", READER)
    files = "dissect/packets/source/files.py"
    tree.replace(files, PCAP_FOUND, PLAIN_FOUND + PCAP_FOUND)
    pcapng = "from dissect.packets.source.pcapng import BYTE_ORDER_MAGICS, PCAPNG_MAGIC, PcapngReader\n"
    tree.replace(files, pcapng, f"{pcapng}from dissect.packets.source.plain import PLAIN_MAGIC, PlainReader\n")
    tree.write("tests/packets/source/test_plain.py", READER_TEST)
    assert {name.replace("plain", "NAME") for name in tree.touched()} == listed("To add a source of packets")
    assert "passed" in tree.python(
        "-m", "pytest", "-q", "-n", "0", "-p", "no:cacheprovider", "tests/packets/source/test_plain.py"
    )
    one, other = json.loads(tree.python("-c", SOURCE_TRIED, "captures/item-errors.pcapng", str(tmp_path / "plain")))
    assert one == other > 10


# ---- a protocol -----------------------------------------------------------------------------------------------------

#: Messages of the made protocol: a mark, the number of bytes that follow, these bytes.
FRAMING: Final = '''"""Tally messages: 0xC5, a length of one byte, so many bytes."""

from __future__ import annotations

from typing import Final

NAME: Final = "tally"
MARK: Final = 0xC5


def whole_messages(octets: bytes) -> tuple[int, int]:
    """Return how many whole messages ``octets`` begin with, and how many bytes these are."""
    count = at = 0
    while at + 2 <= len(octets) and octets[at] == MARK and at + 2 + octets[at + 1] <= len(octets):
        at += 2 + octets[at + 1]
        count += 1
    return count, at
'''
PROTOCOL: Final = '''"""Tally: messages are counted."""

from __future__ import annotations

from mypy_extensions import i64

from dissect.protocols.tally.framing import MARK, NAME, whole_messages
from dissect.engine.transactions.connection import FOLLOWED
from dissect.engine.transactions.protocol import Kept, Protocol
from dissect.engine.transactions.side import Side


class Tally(Protocol):
    """Counts the messages of its connections."""

    def __init__(self) -> None:
        super().__init__(FOLLOWED)
        self.messages: int = 0

    def probe(self, side: Side, octets: bytes, at_start: bool) -> bool:
        """Tell whether a connection begins with a message."""
        return at_start and octets[0] == MARK

    def begin(self, side: Side, at_start: bool) -> None:
        """A connection speaks it."""
        assert side.peer is not None
        side.connection.protocol = NAME
        side.kept = Kept()
        side.peer.kept = Kept()

    def feed(self, side: Side, buf: bytes, at: i64, size: i64, frame: i64, time_ns: i64) -> None:
        """Take the next bytes of a connection."""
        kept = side.kept
        assert kept is not None
        octets = kept.octets + buf[at : at + size]
        count, used = whole_messages(octets)
        self.messages += count
        kept.framed += used
        kept.octets = octets[used:]
        if kept.octets and kept.octets[0] != MARK:
            kept.skipped += len(kept.octets)
            kept.octets = b""

    def describe(self) -> dict[str, object]:
        """Return the section ``tally``."""
        return {"tally": {"messages": self.messages}}

    def counted(self) -> list[tuple[int, str]]:
        """Return the number of messages where there are any."""
        return [(self.messages, "tally message")] if self.messages else []
'''


def tally_capture() -> bytes:
    """A connection to port 7000 on which one side sends three messages in four segments, one of them cut in two."""
    sent = [b"\xc5\x02ab", b"\xc5\x00\xc5\x05he", b"llo"]
    pieces = [struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 262144, 1)]
    seq = 1000

    def packet(flags: int, payload: bytes = b"", *, back: bool = False) -> None:
        ends = struct.pack(">HH", 7000, 50000) if back else struct.pack(">HH", 50000, 7000)
        numbers = struct.pack(">II", 5000 + (not flags & 2), seq) if back else struct.pack(">II", seq, 5001)
        tcp = ends + numbers + struct.pack(">BBHHH", 0x50, flags, 8192, 0, 0) + payload
        hosts = bytes((10, 0, 0, 2, 10, 0, 0, 1) if back else (10, 0, 0, 1, 10, 0, 0, 2))
        ip = struct.pack(">BBHHHBBH", 0x45, 0, 20 + len(tcp), 1, 0, 64, 6, 0) + hosts
        octets = bytes(12) + b"\x08\0" + ip + tcp
        pieces.append(struct.pack("<IIII", 1_700_000_000, len(pieces) * 1000, len(octets), len(octets)) + octets)

    packet(0x02)
    seq += 1
    packet(0x12, back=True)
    for message in sent:
        packet(0x18, message)
        seq += len(message)
    packet(0x11)
    return b"".join(pieces)


#: The tests of the copy that such a change concerns, `analyze -T json` of a capture with it and of one without.
PROTOCOL_TRIED: Final = f"""
{RUNNING}
import ast, json
run("tests.meaning.report.schemas")
from click.testing import CliRunner
from dissect.cli import analyze
from tests import test_architecture, test_house
from tests.faces.gathering import is_alone
from tests.meaning.report import schemas, test_contract
modules = {{test_house.module_name(path): path for path in test_house.PACKAGE.rglob("*.py")}}
trees = {{module: ast.parse(path.read_bytes()) for module, path in modules.items() if "tally" in module}}
assert len(trees) == 3
for rule in test_house.RULES:
    assert [wrong for module, tree in trees.items() for wrong in rule(module, tree)] == []
test_architecture.test_the_rooms_are_listed_in_their_order()
test_architecture.test_the_wings_are_listed_with_their_rooms_and_their_sentences()
def analysis(*words):
    ran = CliRunner().invoke(analyze.command, words, standalone_mode=False)
    assert ran.exception is None, ran.exception
    return ran.stdout
found = [json.loads(analysis("-T", "json", name)) for name in sys.argv[1:]]
test_contract.test_enumerations_are_those_of_the_engine()
assert all(is_alone(("capture", "json", f"tally.{{name}}")) for name in found[0]["tally"])
wrong = [wrong for each in found for wrong in schemas.complaints("analysis", each, exact=True)]
assert wrong == [], wrong
print(json.dumps([found[0], analysis(sys.argv[1]), found[1]]))
"""


def test_to_add_a_protocol(tree: Tree, tmp_path: Path) -> None:
    tree.write("dissect/protocols/tally/__init__.py", '"""Tally messages."""\n')
    tree.write("dissect/protocols/tally/framing.py", FRAMING)
    tree.write("dissect/engine/tally.py", PROTOCOL)
    pipeline = "dissect/engine/pipeline.py"
    tree.replace(pipeline, "streams: list[Protocol] = [self.ibh]", "streams: list[Protocol] = [self.ibh, Tally()]")
    timers = "from dissect.engine.timers import"
    tree.replace(pipeline, timers, f"from dissect.engine.tally import Tally\n{timers}")
    house = (tree.root / "tests/test_house.py").read_text(encoding="utf-8")
    assert house.count('"ibh",') == 2  # WINGS and PURE
    tree.write("tests/test_house.py", house.replace('"ibh",', '"ibh", "tally",'))
    row = "| `s7` | "
    tree.replace("docs/architecture.md", row, f"| `tally` | tally messages |\n{row}")
    tree.replace("docs/architecture.md", "tls, iso, ibh, s7, ", "tls, iso, ibh, tally, s7, ")
    section = '    "s7": {\n      "type": "object",'
    made = '    "tally": {"$ref": "#/$defs/counts", "description": "Tally messages: `messages`."},\n'
    schema = "dissect/meaning/schema/analysis.schema.json"
    tree.replace(schema, section, made + section)
    tree.replace("dissect/meaning/facts/connection.py", '"ibh_netlink", "scd")', '"ibh_netlink", "tally", "scd")')
    names = "{None, IBH_NETLINK, *UPPER_NAMES}"
    tree.replace("tests/meaning/report/test_contract.py", names, '{None, IBH_NETLINK, "tally", *UPPER_NAMES}')
    capture = tmp_path / "tally.pcap"
    capture.write_bytes(tally_capture())
    told, line, others = json.loads(tree.python("-c", PROTOCOL_TRIED, str(capture), "captures/crafted/netlink.pcapng"))
    room, outside = "dissect/protocols/tally/", tree.touched()
    files = {room if name.startswith(room) else name for name in outside}
    assert files == {name.replace("NAME", "tally") for name in listed("To add a protocol")}
    assert len(files - {room}) <= MOST
    assert told["tally"] == {"messages": 3}
    assert [(one["protocol"], one["client"]) for one in told["connections"]] == [("tally", "10.0.0.1:50000")]
    octets = told["loss"]["octets"]
    assert (octets["framed"], octets["skipped"], octets["buffered"]) == (13, 0, 0)
    assert "3 tally messages" in line
    assert (others["tally"], sum(others["ibh"].values()) > 0, others["s7"]["pdus"] > 0) == ({"messages": 0}, True, True)
