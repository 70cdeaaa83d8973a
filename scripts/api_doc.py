"""Write docs/api.md from the source: `PYTHONPATH=. python scripts/api_doc.py > docs/api.md`."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path
from typing import Final

import dissect
from dissect.wire.attribute_tables import ATTRIBUTES

ROOT: Final = Path(dissect.__file__).parent

INTRO: Final = """# Python API

Made from the source (`scripts/api_doc.py`); a test keeps it so, and runs the examples. `help(dissect.Transaction)` shows the
same. Names that are not on this page or in `dissect.scd`, `dissect.layers` ([layers.md](layers.md)), `dissect.meaning.tags`
([tags.md](tags.md)) and the modules that other pages name are internal.

## What is promised

- A name on this page keeps its meaning within a major version. What is added is in the changelog.
- A name that is replaced stays as an alias for at least one minor version, with a DeprecationWarning.
- Attributes are what is known, methods are what is computed. Names with an underscore in front are internal.
- Objects are values for reading: they copy, deep-copy and pickle, also between the compiled and the interpreted build of one
  version. Two objects are equal only if they are the same object; compare what they say (`as_dict()`, `repr()`).
  Items are tuples, and equal where their content is.
- A copy has what is known at that moment, and no session keys. A `Run`, a `Live` and a `Stream` cannot be
  copied; the error says so. What public objects hold copies and pickles as well.
- Everything wrong with what is given raises a `dissect.Error`. What is wrong inside a capture is a finding and raises nothing.
  What your own `Observer` raises reaches you, from `Run.step` or `Run.read`, and ends the reading.
- `from dissect import *` brings every name on this page, `open` among them, as that of gzip and os does.
- Types: mypy in strict mode and pyright know them all. mypy takes some numbers for `i64`, an `int` that it does not divide by a
  float: `time_ns / 1_000_000_000`, or `int(time_ns) / 1e9`.
- Threads: each run, `Live` and `Stream` belongs to one thread or task. Several of them run side by side in threads and give
  what they give alone. Results may be read by any thread; functions, `Where`, dictionaries and tag sets may be shared.

## Programs

[examples.md](examples.md) has a program for each usual task. Items of all protocols, refused ones included:

```python
import dissect

for event in dissect.open("captures/item-errors.pcapng", pdus=False):
    if isinstance(event, dissect.Transaction):
        for item in event.items:
            print(item.address, item.type, item.value if item.ok else item.result)
```

All cores (in a script, below `if __name__ == "__main__":` where processes are spawned):

```python
from concurrent.futures import ProcessPoolExecutor

with ProcessPoolExecutor(2) as pool:
    analyses = list(pool.map(dissect.analyze, ["captures/item-errors.pcapng", "captures/answer-lost.pcapng"]))
print([analysis.total for analysis in analyses])
```

An open file, a capture in memory, packets of your own:

```python
import io
from pathlib import Path

octets = Path("captures/item-errors.pcapng").read_bytes()
print(dissect.analyze(io.BytesIO(octets)).total)
packets = [(1_700_000_000_000_000_000, 1, bytes(60))]  # time in nanoseconds, LINKTYPE number, octets
print(dissect.analyze(packets).pipeline.frames)
```

An interface (`filter` is a capture filter; [live.md](live.md) says who may capture):

```text
with dissect.live("eth0", filter="tcp port 102") as events:
    for event in events:
        print(event)
    print(events.drops)
```

A proxy or gateway of your own, also with asyncio:

```python
import asyncio


async def follow(reader: asyncio.StreamReader) -> list[object]:
    talk, found = dissect.stream(("10.0.0.1", 4000), ("10.0.0.2", 102)), []
    while octets := await reader.read(4096):
        found += talk.client_sent(octets)
    return found + talk.close()


async def main() -> None:
    reader = asyncio.StreamReader()
    reader.feed_data(bytes.fromhex("0300001f02f080320100000200000e00000401120a10020002000184000000"))
    reader.feed_eof()
    print(await follow(reader))


asyncio.run(main())
```

Threads:

```python
from concurrent.futures import ThreadPoolExecutor

with ThreadPoolExecutor(2) as pool:
    print([analysis.total for analysis in pool.map(dissect.analyze, ["captures/item-errors.pcapng"] * 2)])
```

## Names
"""

#: The example for each name: the lines after a comment with the name.
EXAMPLES: Final = """
# Act
class Acts(dissect.Observer):
    def act(self, act: dissect.Act) -> None:
        print(act)


dissect.Run("captures/plc-control.pcapng", Acts()).read()
# Analysis
analysis = dissect.analyze("captures/item-errors.pcapng")
print(analysis, analysis.latencies.quantile(0.5))
# CaptureError
try:
    dissect.analyze("missing.pcap")
except FileNotFoundError as error:
    print(error)
# CarvedBlock
for block in dissect.blocks("captures/item-errors.pcapng"):
    print(block.kind, block.number)
# Connection
print([repr(one) for one in analysis.connections], analysis.connections[0].client.host)
# Device
for device in dissect.devices("captures/item-errors.pcapng"):
    print(device.address)
# Error
try:
    dissect.Where("latency >")
except dissect.Error as error:
    print(error)
# Finding
print([(finding.slug, finding.severity, finding.detail) for finding in analysis.findings])
# KeyLogError
try:
    dissect.open("captures/item-errors.pcapng", tls_keys="plant.toml")  # needs s7dissect[tls]
except dissect.KeyLogError as error:
    print(error)
# Observer
class Count(dissect.Observer):
    total = 0

    def transaction(self, transaction: dissect.Transaction) -> None:
        self.total += 1


mine = Count()
dissect.Run(["captures/item-errors.pcapng"], mine).read()
print(mine.total)
# Operation
events = list(dissect.open("captures/item-errors.pcapng"))
print([event.kind for event in events if isinstance(event, dissect.Operation)])
# Options
print(dissect.Options(slow_ns=100_000_000))
# Pdu
print([event.function_name for event in events if isinstance(event, dissect.Pdu)][:3])
# Pipeline
pipeline = dissect.Pipeline(dissect.Observer())
pipeline.frame(0, bytes(60), 0, 60, 60, 1)
pipeline.finish()
print(pipeline.frames)
# PlusPdu
print([event.function_name for event in events if isinstance(event, dissect.PlusPdu)])
# Run
run = dissect.Run("captures/item-errors.pcapng", dissect.Observer())
while run.step():
    pass
print(run.files[0].packets)
# ScdMessage
for event in dissect.open("plant.pcapng", scd="plant.toml", bind="plant.bind.toml"):
    if isinstance(event, dissect.ScdMessage):
        print(event.subject)
# SelectError
try:
    dissect.open("captures/item-errors.pcapng", where="latancy > 1 ms")
except dissect.SelectError as error:
    print(error)
# TagError
try:
    dissect.open("captures/item-errors.pcapng", tags="plant.bind.toml")
except dissect.TagError as error:
    print(error)
# Transaction
transaction = next(event for event in events if isinstance(event, dissect.Transaction))
print(transaction, transaction.latency_ns, transaction.as_dict()["outcome"])
# TransactionError
print([error.text for event in events if isinstance(event, dissect.Transaction) for error in event.errors])
# TransactionItem
print([(item.address, item.value, item.ok) for item in transaction.items])
# ValueRow
for row in dissect.values("captures/item-errors.pcapng", refusals=True):
    print(row.name, row.value, row.refused)
# Where
where = dissect.Where('function contains "Read" and latency > 0 ms')
print(where.transaction(transaction))
# analyze
print(dissect.analyze("captures/item-errors.pcapng").as_dict()["transactions"])
# blocks
print(dissect.blocks("captures/item-errors.pcapng"))
# devices
print(len(list(dissect.devices("captures/item-errors.pcapng"))))
# frames
try:
    print(dissect.frames("captures/item-errors.pcapng", library="arrow", tables="items"))
except ImportError as error:
    print(error)
# live
try:
    dissect.live("no-such-interface")
except dissect.Error as error:
    print(error)
# open
print([event for event in dissect.open("captures/item-errors.pcapng", pdus=False)][-1])
# stream
print(dissect.stream(begun=True).client_sent(b""))
# value_tables
try:
    print(list(dissect.value_tables(dissect.values("captures/item-errors.pcapng"))))
except ImportError as error:
    print(error)
# values
print(next(iter(dissect.values("captures/item-errors.pcapng"))))
"""

ABOUT_GIVEN: Final = """Objects that the functions return and that attributes hold. Your program reads them and does not make
them; their public members keep their meaning, too."""


def text_of(node: ast.AST) -> str:
    """Return a docstring as Markdown."""
    assert isinstance(node, (ast.ClassDef, ast.FunctionDef))
    pieces = re.split(r"(``[^`]+``|`[^`]+`)", ast.get_docstring(node) or "")
    return "".join([piece.replace("``", "`") if piece.startswith("`") else reworded(piece) for piece in pieces])


#: Words of the standards in docstrings, and the field's words for pages (byte, not octet).
WORDS: Final = {"octets": "bytes", "Octets": "Bytes", "octet": "byte", "Octet": "Byte", "anew": "again"}


def reworded(text: str) -> str:
    """Return a piece of prose in the words of the pages."""
    return re.sub(r"\b\w+\b", lambda word: WORDS.get(word[0], word[0]), text)


def first(text: str) -> str:
    """Return the first paragraph in one line, for a table."""
    return " ".join(text.split("\n\n", maxsplit=1)[0].split()).replace("|", "\\|")


#: Classes of the results of public functions and attributes. They are only reached through these.
GIVEN: Final = {
    "Live": "dissect.online.live.iterating",
    "Stream": "dissect.online.proxy.stream",
    "Frames": "dissect.output.export.frames",
    "Endpoint": "dissect.packets.tcp.stream",
    "Ending": "dissect.engine.transactions.ending",
    "Latencies": "dissect.meaning.report.latencies",
    "SourceFile": "dissect.packets.source.packet",
    "ItemResult": "dissect.protocols.s7.items",
    "PlusItem": "dissect.protocols.s7plus.items",
    "Body": "dissect.protocols.s7.body",
    "Part": "dissect.wire.part",
}


def definition(name: str) -> ast.ClassDef | ast.FunctionDef:
    """Return the definition of a public name in the source, because compiled classes have no signatures with types."""
    home = "dissect.online.live.iterating" if name == "live" else GIVEN.get(name) or getattr(dissect, name).__module__
    path = ROOT.joinpath(*home.split(".")[1:]).with_suffix(".py")
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, (ast.ClassDef, ast.FunctionDef)) and node.name == name:
            return node
    raise LookupError(name)


def members(node: ast.ClassDef) -> list[str]:
    """Return the rows of the table of a class: its attributes, properties and methods that are public."""
    attributes = ATTRIBUTES.get(node.name, {}).items()
    rows = [f"| `{name}` | {reworded(first(said))} |" for name, said in attributes if "internal" not in said]
    for one in node.body:
        if isinstance(one, ast.FunctionDef) and not one.name.startswith("_") and ast.get_docstring(one):
            marks = {each.id for each in one.decorator_list if isinstance(each, ast.Name)}
            arguments = ", ".join(each.arg for each in [*one.args.args[1:], *one.args.kwonlyargs])
            called = f"`{one.name}`" if "property" in marks else f"`{one.name}({arguments})`"
            rows.append(f"| {called} | {first(text_of(one))} |")
    return rows


def section(name: str) -> list[str]:
    """Return the section of a public name."""
    node = definition(name)
    lines = [f"### {name}", ""]
    if isinstance(node, ast.FunctionDef):
        lines += ["```text", f"{name}({ast.unparse(node.args)})", "```", ""]
    lines += [text_of(node), ""]
    rows = members(node) if isinstance(node, ast.ClassDef) else []
    if rows:
        lines += ["| member | |", "|---|---|", *rows, ""]
    return [*lines, "```python", examples()[name], "```", ""] if name in examples() else lines


@cache
def examples() -> dict[str, str]:
    """Return the example of each name."""
    return {
        name: code.strip()
        for name, code in re.findall(r"^# (\w+)\n(.*?)(?=^# |\Z)", EXAMPLES, re.MULTILINE | re.DOTALL)
    }


def public() -> list[str]:
    """Return the public names, as they are looked up."""
    return sorted(set(dir(dissect)) & set(examples()), key=str.lower)


def document() -> str:
    """Return the page."""
    lines = [line for name in public() for line in section(name)]
    given = [line for name in GIVEN for line in section(name)]
    return INTRO + "\n" + "\n".join([*lines, "## What these give", "", ABOUT_GIVEN, "", *given])


if __name__ == "__main__":
    print(document(), end="")
