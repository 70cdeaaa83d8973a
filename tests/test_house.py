"""The rules of the house: who may import whom, what the engine must not touch, names and sizes."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Final

import pytest

import dissect
from tests.module_state import changed_state

PACKAGE: Final = Path(__file__).resolve().parent.parent / "dissect"

#: The way of a packet: the wings and the rooms in each. A room imports itself and what stands before it; one that is called
#: as its wing stands in the wing itself.
WINGS: Final = {
    "wire": ("wire", "config"),
    "scd": ("scd",),
    "packets": ("source", "tcp"),
    "protocols": ("tls", "iso", "ibh", "s7", "mc7", "s7plus"),
    "engine": ("transactions", "program", "acts", "stations", "findings", "engine"),
    "meaning": ("bindings", "tags", "facts", "report", "inventory", "select"),
    "files": ("recording", "anonymize", "session", "index", "jobs", "cluster"),
    "output": ("carve", "variables", "baseline", "export", "page", "browser"),
    "online": ("net", "alerts", "live", "monitor", "metrics", "proxy"),
    "testing": ("golden", "playback", "oracle", "testing"),
    "layers": ("layers",),
    "cli": ("cli",),
}
#: All rooms, in that order.
ORDER: Final = tuple(room for rooms in WINGS.values() for room in rooms)
#: Rooms that show the package to somebody; only they may ask the package itself for its version or its public names.
FACES: Final = frozenset(("report", "metrics", "layers", "oracle", "testing", "cli"))

#: Rooms between a packet and a finding: no file, socket, clock, thread or log.
PURE: Final = frozenset(
    (
        "tcp",
        "tls",
        "iso",
        "ibh",
        "s7",
        "mc7",
        "s7plus",
        "transactions",
        "program",
        "acts",
        "stations",
        "findings",
        "engine",
    )
)
PURE_IMPORTS: Final = frozenset(
    (
        "__future__",
        "bisect",
        "codecs",
        "collections",
        "datetime",
        "difflib",
        "enum",
        "functools",
        "hashlib",
        "heapq",
        "hmac",
        "itertools",
        "librt",
        "math",
        "mypy_extensions",
        "operator",
        "re",
        "struct",
        "typing",
        "warnings",
        "zlib",
    )
)
#: What pure modules remember: what a function returned for the same arguments, so that no result depends on it; and numbers
#: that are given out once each.
MEMORY: Final = {
    "dissect.protocols.mc7.code": "_rows",
    "dissect.protocols.s7.errors": "_TABLES",
    "dissect.protocols.s7.message": "_CUT",
    "dissect.protocols.s7plus.blobs": "_SOUND",
    "dissect.protocols.s7plus.contents": "_KNOWN",
    "dissect.protocols.s7plus.pieces": "_KNOWN",
    "dissect.protocols.s7plus.stamps": "_STAMPS",
}
IMPURE_CALLS: Final = frozenset(("breakpoint", "input", "open", "print"))
CLOCK_CALLS: Final = frozenset(("now", "today", "utcnow"))

#: Third-party packages that stay in one room.
LOCKED: Final = {
    "cryptography": "tls",
    "duckdb": "export",
    "fsspec": "source",
    "jinja2": "page",
    "markupsafe": "page",
    "scapy": "layers",
    "pyshark": "oracle",
    "textual": "monitor",
    "pytest": "testing",
}

#: What is data only, in the one module that reads it: Wireshark's list of vendors, as Scapy ships it.
DATA_ONLY: Final = {"dissect.meaning.facts.vendors": "scapy.libs.manuf"}

#: They run what they read.
DANGEROUS_IMPORTS: Final = frozenset(("cPickle", "dill", "jsonpickle", "marshal", "pickle", "shelve", "yaml"))
DANGEROUS_CALLS: Final = frozenset(("__import__", "compile", "eval", "exec"))
#: Of any module: what gives words to a shell, and what reads a file as code or as objects.
DANGEROUS_METHODS: Final = frozenset(("popen", "system", "getoutput", "getstatusoutput", "unsafe_load"))

#: What another project keeps in a namespace called `dissect`; whoever has both installed needs both.
FOREIGN: Final = frozenset(
    (
        "apfs",
        "archive",
        "btrfs",
        "cim",
        "clfs",
        "container",
        "cramfs",
        "cstruct",
        "database",
        "disc",
        "esedb",
        "etl",
        "eventlog",
        "evidence",
        "executable",
        "extfs",
        "fat",
        "ffs",
        "fve",
        "hypervisor",
        "jffs",
        "memory",
        "network",
        "ntfs",
        "ole",
        "qnxfs",
        "regf",
        "shellitem",
        "sql",
        "squashfs",
        "target",
        "thumbcache",
        "util",
        "vmfs",
        "volume",
        "xfs",
    )
)
EMPTY_NAMES: Final = frozenset(("base", "common", "helpers", "manager", "misc", "util", "utils"))

#: How many wings a person can look over, and rooms in each.
MOST_WINGS: Final = 12
MOST_ROOMS: Final = 9
#: A file past this is usually two things. Never cut one thing in two to stay below it.
MAX_LINES: Final = 600
#: Tables are as long as what they list.
TABLES: Final = re.compile(r"(^|_)(tables|errors)\.py$")

Import = tuple[int, str]
Rule = Callable[[str, ast.Module], list[str]]


def module_name(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def room_of(module: str) -> str:
    """Return the room of a module of ours, empty for the package itself, and the name of a wing for its own package."""
    parts = module.split(".")
    inside = parts[2] if len(parts) > 2 and parts[2] in WINGS.get(parts[1], ()) else ""
    return inside or (parts[1] if len(parts) > 1 else "")


@cache
def nodes(tree: ast.Module) -> list[ast.AST]:
    """Return every node of a module: each rule looks at all of them."""
    return list(ast.walk(tree))


def imports(tree: ast.Module) -> Iterator[Import]:
    """Give (line, module) for every import, those inside functions and for type checkers included.

    ``from dissect.packets import tcp`` gives ``dissect.packets.tcp``, ``from dissect import __version__`` gives ``dissect``.
    """
    for node in nodes(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield node.lineno, alias.name
        elif isinstance(node, ast.ImportFrom):
            if node.level:
                yield node.lineno, "." * node.level + (node.module or "")
            elif node.module == "dissect":
                for alias in node.names:
                    yield node.lineno, f"dissect.{alias.name}" if alias.name in WINGS else "dissect"
            elif (node.module or "").removeprefix("dissect.") in WINGS:
                for alias in node.names:
                    yield node.lineno, f"{node.module}.{alias.name}"
            else:
                yield node.lineno, node.module or ""


def calls(tree: ast.Module) -> Iterator[tuple[int, str, bool]]:
    """Give (line, name, whether it is an attribute) for every call."""
    for node in nodes(tree):
        if isinstance(node, ast.Call):
            if isinstance(node.func, ast.Name):
                yield node.lineno, node.func.id, False
            elif isinstance(node.func, ast.Attribute):
                yield node.lineno, node.func.attr, True


def imports_only_point_down(module: str, tree: ast.Module) -> list[str]:
    room = room_of(module)
    if room in {"", "__main__"} or is_bare_wing(module):
        return []
    if room not in ORDER:
        return [f"{module}: the room {room} has no place on the way of a byte"]
    wrong = []
    for line, name in imports(tree):
        if name.startswith("."):
            wrong.append(f"{module}:{line}: a relative import")
        elif name == "dissect" and room not in FACES:
            wrong.append(f"{module}:{line}: imports the package itself")
        elif name.startswith("dissect."):
            target = room_of(name)
            if target not in ORDER:
                wrong.append(f"{module}:{line}: {name} is in no room")
            elif ORDER.index(target) > ORDER.index(room):
                wrong.append(f"{module}:{line}: {room} imports {name}, which comes later")
    return wrong


def is_bare_wing(module: str) -> bool:
    """Tell whether a module is the package of a wing whose modules are all in rooms."""
    wing = module.removeprefix("dissect.")
    return wing in WINGS and wing not in WINGS[wing]


def a_wing_is_one_sentence(module: str, tree: ast.Module) -> list[str]:
    """The package of a wing says in one sentence what the wing is for, and imports nothing."""
    if not is_bare_wing(module):
        return []
    text = ast.get_docstring(tree) or ""
    return [] if len(tree.body) == 1 and text.endswith(".") and ". " not in text else [f"{module}: not one sentence"]


def packages_stay_in_their_room(module: str, tree: ast.Module) -> list[str]:
    return [
        f"{module}:{line}: {name} belongs in {LOCKED[name.split('.')[0]]}/"
        for line, name in imports(tree)
        if LOCKED.get(name.split(".")[0], room_of(module)) != room_of(module) and DATA_ONLY.get(module) != name
    ]


def the_engine_is_pure(module: str, tree: ast.Module) -> list[str]:
    if room_of(module) not in PURE:
        return []
    wrong = [
        f"{module}:{line}: imports {name}"
        for line, name in imports(tree)
        if name.split(".")[0] not in PURE_IMPORTS | {"dissect"} and LOCKED.get(name.split(".")[0]) != room_of(module)
    ]
    wrong += [
        f"{module}:{line}: calls {name}()"
        for line, name, attribute in calls(tree)
        if not attribute and name in IMPURE_CALLS
    ]
    wrong += [
        f"{module}:{line}: asks .{name}() the time"
        for line, name, attribute in calls(tree)
        if attribute and name in CLOCK_CALLS
    ]
    return wrong + [
        f"{module}:{line}: {name} is state of the module: let an object have it"
        for line, name in changed_state(tree)
        if MEMORY.get(module) != name
    ]


def nothing_runs_what_it_reads(module: str, tree: ast.Module) -> list[str]:
    wrong = [f"{module}:{line}: {name}" for line, name in imports(tree) if name.split(".")[0] in DANGEROUS_IMPORTS]
    wrong += [
        f"{module}:{node.lineno}: a shell"
        for node in nodes(tree)
        if isinstance(node, ast.keyword) and node.arg == "shell"
    ]
    return wrong + [
        f"{module}:{line}: {name}()"
        for line, name, attribute in calls(tree)
        if name in (DANGEROUS_METHODS if attribute else DANGEROUS_CALLS)
    ]


#: Who may read JSON, TOML, SQLite and names of code pages without `dissect.wire.config.hostile`: what they read is our own.
OWN_CONTENT: Final = {
    "dissect.wire.config.hostile": "reads it for everybody",
    "dissect.testing.golden.values": "a text that our parser cut out, within its quotes",
    "dissect.meaning.report.contract": "lines that our writer made a moment ago",
    "dissect.meaning.report.kept": "what the same process packed",
    "dissect.output.variables.summary": "lines that our writer made a moment ago",
    "dissect.cli.separate_export": "rows that our own processes sent",
    "dissect.output.browser.parts": "our own list of packages",
    "dissect.cli.schema": "the schemas of the package",
    "dissect.output.export.sqlite": "only writes a new file",
    "dissect.files.index.store": "catches DATABASE_ERRORS",
    "dissect.protocols.s7.values": "only the decoder of UTF-16",
    "dissect.meaning.tags.decoding": "only names of byte order marks",
}
HOSTILE_CALLS: Final = frozenset(("json.loads", "json.load", "tomllib.loads", "tomllib.load", "codecs.lookup"))


def hostile_content_has_one_reader(module: str, tree: ast.Module) -> list[str]:
    if module in OWN_CONTENT:
        return []
    wrong = [
        f"{module}:{line}: {name}" for line, name in imports(tree) if name in {"sqlite3", "tomllib", "codecs", "pickle"}
    ]
    return wrong + [
        f"{module}:{node.lineno}: {ast.unparse(node.func)}()"
        for node in nodes(tree)
        if isinstance(node, ast.Call) and ast.unparse(node.func) in HOSTILE_CALLS
    ]


def names_say_something(module: str, tree: ast.Module) -> list[str]:
    parts = module.split(".")
    wrong = [f"{module}: another project's {parts[1]}"] if len(parts) > 1 and parts[1] in FOREIGN else []
    if not EMPTY_NAMES.isdisjoint(word for part in parts for word in part.split("_")):
        wrong.append(f"{module}: a name that says nothing")
    for node in nodes(tree):
        if isinstance(node, ast.ClassDef):
            words = re.findall(r"[A-Z][a-z]+|[a-z]+", node.name)
            if not EMPTY_NAMES.isdisjoint(word.lower() for word in words):
                wrong.append(f"{module}:{node.lineno}: {node.name} says nothing")
    return wrong


#: What an assert may be made of, besides the question for a type: names, constants and comparisons.
NARROWING: Final = (
    *(ast.expr_context, ast.boolop, ast.cmpop, ast.operator, ast.unaryop, ast.BoolOp, ast.Compare, ast.UnaryOp),
    *(ast.Name, ast.Attribute, ast.Constant, ast.Subscript),
)


def asserts_only_narrow_types(module: str, tree: ast.Module) -> list[str]:
    """An assert may compare names or ask for a type; anything else would be missing under ``python -O``."""
    wrong = []
    for node in nodes(tree):
        if isinstance(node, ast.Assert):
            parts = list(ast.walk(node.test))
            asked = {id(part) for call in parts if is_type_question(call) for part in ast.walk(call)}
            if not all(isinstance(part, NARROWING) or id(part) in asked for part in parts):
                wrong.append(f"{module}:{node.lineno}: an assert that does more than narrow a type")
    return wrong


def is_type_question(node: ast.AST) -> bool:
    return isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "isinstance"


def docstrings_name_what_is_there(module: str, tree: ast.Module) -> list[str]:
    """What a docstring names by its module is there; that of a package names modules of its own, or what it imports."""
    wrong = []
    for node in nodes(tree):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)):
            names = re.findall(r"(?<!`)`(dissect\.\w+\.[\w.]+)`", ast.get_docstring(node) or "")
            wrong += [f"{module}: {name} is not there" for name in names if not is_there(name)]
    folder = PACKAGE.parent.joinpath(*module.split("."))
    if folder.is_dir():
        bound = {
            alias.asname or alias.name
            for node in nodes(tree)
            if isinstance(node, ast.ImportFrom)
            for alias in node.names
        }
        bound |= {"dissect", *(path.stem for path in folder.iterdir())}
        names = re.findall(r"(?<!`)`([a-z_0-9]+)(?:\.\w+)*`", ast.get_docstring(tree) or "")
        wrong += [f"{module}: {name} is no module of it" for name in names if name not in bound]
    return wrong


def is_there(name: str) -> bool:
    """Tell whether a name of ours begins with a module in whose source the rest stands."""
    parts = name.split(".")
    for size in range(len(parts), 1, -1):
        place = PACKAGE.parent.joinpath(*parts[:size])
        for path in (place.with_suffix(".py"), place / "__init__.py"):
            if path.is_file():
                return all(word in path.read_text(encoding="utf-8") for word in parts[size:])
    return False


RULES: Final[tuple[Rule, ...]] = (
    imports_only_point_down,
    a_wing_is_one_sentence,
    packages_stay_in_their_room,
    the_engine_is_pure,
    nothing_runs_what_it_reads,
    hostile_content_has_one_reader,
    names_say_something,
    asserts_only_narrow_types,
    docstrings_name_what_is_there,
)


@pytest.fixture(scope="module")
def modules() -> dict[str, ast.Module]:
    """Every module of the package, parsed."""
    found = {module_name(path): ast.parse(path.read_bytes(), str(path)) for path in sorted(PACKAGE.rglob("*.py"))}
    assert {"dissect", "dissect.wire.codes", "dissect.cli.main"} <= found.keys()
    return found


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.__name__)
def test_rule_holds(rule: Rule, modules: dict[str, ast.Module]) -> None:
    assert [wrong for module, tree in modules.items() for wrong in rule(module, tree)] == []


@pytest.mark.parametrize(
    ("rule", "module", "source"),
    [
        (imports_only_point_down, "dissect.packets.tcp.stream", "from dissect.protocols.s7.tables import JOB"),
        (imports_only_point_down, "dissect.packets.tcp.stream", "from dissect import cli"),
        (imports_only_point_down, "dissect.packets.tcp.stream", "def late():\n    import dissect.meaning.report.text"),
        (imports_only_point_down, "dissect.packets.tcp.stream", "from dissect import __version__"),
        (imports_only_point_down, "dissect.packets.tcp.stream", "from .ip import Packet"),
        (imports_only_point_down, "dissect.cli.show", "from dissect.nowhere import thing"),
        (imports_only_point_down, "dissect.attic.thing", ""),
        (imports_only_point_down, "dissect.packets.attic.thing", ""),
        (imports_only_point_down, "dissect.packets.source.files", "from dissect.packets import tcp"),
        (imports_only_point_down, "dissect.packets.tcp.stream", "from dissect import packets"),
        (a_wing_is_one_sentence, "dissect.packets", '"""Packets."""\nfrom dissect.packets import tcp'),
        (a_wing_is_one_sentence, "dissect.packets", '"""Packets. Segments."""'),
        (packages_stay_in_their_room, "dissect.cli.show", "def late():\n    from scapy.all import rdpcap"),
        (packages_stay_in_their_room, "dissect.layers.s7", "import pyshark"),
        (the_engine_is_pure, "dissect.protocols.s7.message", "import time"),
        (the_engine_is_pure, "dissect.engine.pipeline", "from asyncio import sleep"),
        (the_engine_is_pure, "dissect.engine.findings.rules", "print('found')"),
        (the_engine_is_pure, "dissect.protocols.iso.tpkt", "octets = open('x').read()"),
        (the_engine_is_pure, "dissect.protocols.s7.values", "from datetime import datetime\nt = datetime.now()"),
        (the_engine_is_pure, "dissect.protocols.s7plus.check", "_FREE = []\ndef done(one):\n    _FREE.append(one)"),
        (
            the_engine_is_pure,
            "dissect.protocols.s7plus.check",
            "_LATEST = Latest()\ndef keep(one):\n    _LATEST.pdu = one",
        ),
        (the_engine_is_pure, "dissect.protocols.s7.message", "_ROWS = {}\ndef row(one):\n    _ROWS[one] = 1"),
        (
            the_engine_is_pure,
            "dissect.protocols.s7.message",
            "LATEST = 0\ndef keep(one):\n    global LATEST\n    LATEST = one",
        ),
        (nothing_runs_what_it_reads, "dissect.meaning.report.json", "import pickle"),
        (nothing_runs_what_it_reads, "dissect.cli.show", "eval('1')"),
        (nothing_runs_what_it_reads, "dissect.cli.show", "import subprocess\nsubprocess.run('ls', shell=True)"),
        (nothing_runs_what_it_reads, "dissect.cli.show", "import os\nos.system('ls')"),
        (nothing_runs_what_it_reads, "dissect.scd.loading", "import yaml\nyaml.load('1')"),
        (hostile_content_has_one_reader, "dissect.output.carve.folder", "import json\njson.loads(text)"),
        (hostile_content_has_one_reader, "dissect.cli.sql", "import sqlite3"),
        (hostile_content_has_one_reader, "dissect.scd.loading", "def late():\n    from tomllib import loads"),
        (names_say_something, "dissect.network", ""),
        (names_say_something, "dissect.packets.tcp.stream_utils", ""),
        (names_say_something, "dissect.packets.tcp.stream", "class ConnectionManager:\n    pass"),
        (asserts_only_narrow_types, "dissect.packets.tcp.stream", "assert queue.pop() == 1"),
        (asserts_only_narrow_types, "dissect.packets.tcp.stream", "assert (first := 1) and first"),
        (docstrings_name_what_is_there, "dissect.packets.tcp.stream", '"""See `dissect.packets.tcp.attic`."""'),
        (
            docstrings_name_what_is_there,
            "dissect.packets.tcp.stream",
            'def f():\n    """See `dissect.packets.tcp.ip.Nothing`."""',
        ),
        (docstrings_name_what_is_there, "dissect.online.monitor", '"""`rows` and `saving` make text of it."""'),
    ],
)
def test_rule_sees_its_breach(rule: Rule, module: str, source: str) -> None:
    assert rule(module, ast.parse(source)) != []


@pytest.mark.parametrize(
    ("rule", "module", "source"),
    [
        (
            imports_only_point_down,
            "dissect.protocols.s7.message",
            "from dissect.protocols.s7 import tables\nfrom dissect.wire import codes",
        ),
        (
            imports_only_point_down,
            "dissect.cli.main",
            "from dissect import __version__\nfrom dissect.files import session",
        ),
        (packages_stay_in_their_room, "dissect.layers.s7", "from scapy.packet import Packet"),
        (the_engine_is_pure, "dissect.protocols.s7.values", "from datetime import timedelta\nimport struct"),
        (the_engine_is_pure, "dissect.packets.source.files", "import os\nopen('x')"),
        (
            the_engine_is_pure,
            "dissect.protocols.s7.message",
            "ROWS = {}\nROWS[1] = 2\ndef row(rows):\n    rows[1] = ROWS[1]",
        ),
        (the_engine_is_pure, "dissect.protocols.mc7.code", "_rows = {}\ndef row(one):\n    _rows[one] = 1"),
        (nothing_runs_what_it_reads, "dissect.cli.show", "import re\nre.compile('a')"),
        (hostile_content_has_one_reader, "dissect.output.carve.folder", "import json\njson.dumps(made)"),
        (names_say_something, "dissect.protocols.s7.timebase", "class Database:\n    pass"),
        (
            asserts_only_narrow_types,
            "dissect.packets.tcp.stream",
            "assert held is not None and isinstance(held.octets, bytes)",
        ),
        (
            docstrings_name_what_is_there,
            "dissect.packets.tcp.stream",
            '"""`dissect.packets.tcp.doubt`, `dissect.scd.Codec`, `anything`."""',
        ),
        (docstrings_name_what_is_there, "dissect.online.monitor", '"""`rows`, `model.Model`."""'),
    ],
)
def test_rule_lets_the_rest_be(rule: Rule, module: str, source: str) -> None:
    assert rule(module, ast.parse(source)) == []


def test_the_wings_are_the_folders_and_few() -> None:
    assert {path.name for path in PACKAGE.iterdir() if path.is_dir() and path.name != "__pycache__"} == set(WINGS)
    assert len(WINGS) <= MOST_WINGS
    assert max(map(len, WINGS.values())) <= MOST_ROOMS
    assert len(ORDER) == len(set(ORDER))


def test_files_are_short() -> None:
    lengths = {
        module_name(path): len(path.read_bytes().splitlines())
        for path in PACKAGE.rglob("*.py")
        if not TABLES.search(path.name)
    }
    assert {module: length for module, length in lengths.items() if length > MAX_LINES} == {}


def test_every_public_name_is_there() -> None:
    assert sorted(dissect._PUBLIC) == [name for name in dir(dissect) if name in dissect._PUBLIC]
    for name in dissect._PUBLIC:
        assert callable(getattr(dissect, name)), name
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        getattr(dissect, "nonsense")  # noqa: B009 - a type checker refuses the plain form, which is the point


@pytest.mark.parametrize(
    "statement", ["import dissect", "import dissect.cli.main", "import dissect.wire.codes, dissect.cli.main"]
)
def test_importing_is_cheap(statement: str) -> None:
    heavy = [
        "scapy",
        "rich",
        "msgspec",
        "lark",
        "pyshark",
        "asyncio",
        "fsspec",
        "logging",
        "dissect.files.session",
        "dissect.engine.pipeline",
        "dissect.protocols.s7",
    ]
    code = f"{statement}\nimport sys\nprint(*[name for name in {heavy!r} if name in sys.modules])"
    assert python("-c", code).stdout.split() == []


@pytest.mark.parametrize("option", ["--version", "--help"])
def test_version_and_help_are_cheap(option: str) -> None:
    ran = python("-X", "importtime", "-m", "dissect", option)
    assert ran.stdout.startswith("s7dissect 0." if option == "--version" else "Usage: s7dissect ")
    imported = {line.rsplit("|", 1)[1].strip() for line in ran.stderr.splitlines() if line.startswith("import time:")}
    assert "click" in imported
    assert {name for name in imported if name.split(".")[0] in {"scapy", "rich", "msgspec", "pyshark"}} == set()
    assert {name for name in imported if name.startswith("dissect")} == {
        "dissect",
        "dissect.cli",
        "dissect.cli.collector",
        "dissect.cli.main",
        "dissect.wire",
        "dissect.wire.build",
        "dissect.wire.text",
    }


def python(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the interpreter of these tests, which finds the same package, and give what it said."""
    return subprocess.run(
        [sys.executable, *arguments], stdin=subprocess.DEVNULL, capture_output=True, text=True, check=True
    )
