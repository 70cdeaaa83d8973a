"""Build the package: the hot modules compiled with mypyc where that is possible, interpreted where it is not.

Everything declarative stands in pyproject.toml. Two variables of the environment choose the build:

``S7DISSECT_COMPILED``
    Not set: compile if that is possible here; if not, print one line that says why and install the same source, which runs
    interpreted. ``1``: the same, but a build that cannot compile fails (CI and releases). ``0``: do not compile.

``S7DISSECT_RELEASE``
    Not set: compile fast, as a checkout wants it (a few C files, side by side, optimized a little). ``1``: compile
    for speed, as a published wheel wants it, which takes many minutes: optimized fully, and by gcc twice, the second time
    with what it counted while the first build read captures.

pip shows what a build prints only with ``-v``; ``s7dissect --version`` says which build is installed.
"""

from __future__ import annotations

import ast
import gzip
import os
import re
import runpy
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import tempfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path
from typing import Any, Final

from setuptools import Extension, setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_ext import build_ext
from setuptools.command.build_py import build_py
from setuptools.command.sdist import sdist

# Only importable once setuptools has put its own copy in place.
from distutils.ccompiler import new_compiler  # isort: skip
from distutils.sysconfig import customize_compiler, get_python_inc  # isort: skip

#: The modules on the way of every byte. They import the standard library, mypy_extensions, librt and
#: each other, nothing else.
HOT: Final = (
    "dissect/files/anonymize/checksum.py",
    "dissect/files/anonymize/masked.py",
    "dissect/files/anonymize/messages.py",
    "dissect/files/anonymize/rewrite_plan.py",
    "dissect/files/anonymize/rewriter.py",
    "dissect/files/anonymize/rules.py",
    "dissect/files/anonymize/survey.py",
    "dissect/files/anonymize/track.py",
    "dissect/files/anonymize/usual_packet.py",
    "dissect/meaning/bindings/pushes.py",
    "dissect/testing/golden/exchange.py",
    "dissect/testing/golden/masking.py",
    "dissect/testing/golden/model.py",
    "dissect/testing/golden/reading.py",
    "dissect/testing/golden/writing.py",
    "dissect/testing/golden/usual.py",
    "dissect/wire/*.py",
    "dissect/packets/source/packet.py",
    "dissect/packets/source/packet_blocks.py",
    "dissect/packets/source/pcap.py",
    "dissect/packets/source/pcapng.py",
    "dissect/packets/source/ring_blocks.py",
    "dissect/packets/tcp/*.py",
    "dissect/protocols/tls/records.py",
    "dissect/protocols/iso/*.py",
    "dissect/protocols/ibh/*.py",
    "dissect/protocols/s7/*.py",
    "dissect/protocols/s7plus/*.py",
    "dissect/engine/transactions/*.py",
    "dissect/engine/acts/*.py",
    "dissect/engine/findings/*.py",
    "dissect/engine/*.py",
    "dissect/meaning/inventory/collector.py",
    "dissect/meaning/inventory/model.py",
    "dissect/files/jobs/spots.py",
    "dissect/online/live/events.py",
    "dissect/engine/stations/evidence.py",
    "dissect/engine/stations/facts.py",
    "dissect/meaning/tags/index.py",
    "dissect/meaning/tags/model.py",
    "dissect/meaning/tags/naming.py",
    "dissect/meaning/tags/values.py",
    "dissect/output/export/item_columns.py",
    "dissect/output/export/pdu_columns.py",
    "dissect/output/export/transaction_rows.py",
    "dissect/output/export/value_columns.py",
    "dissect/output/page/bins.py",
    "dissect/output/page/gaps.py",
    "dissect/output/page/gathered.py",
    "dissect/output/page/plcs.py",
    "dissect/output/page/polls.py",
    "dissect/output/page/rows.py",
    "dissect/output/page/samples.py",
    "dissect/output/page/talks.py",
    "dissect/files/recording/cutter.py",
    "dissect/files/recording/recent.py",
    "dissect/meaning/report/analysis.py",
    "dissect/meaning/report/contract.py",
    "dissect/meaning/report/facet.py",
    "dissect/meaning/report/facets.py",
    "dissect/meaning/report/item_json.py",
    "dissect/meaning/report/item_octets.py",
    "dissect/meaning/report/json_page.py",
    "dissect/meaning/report/latencies.py",
    "dissect/meaning/report/line_octets.py",
    "dissect/meaning/report/pdu_json.py",
    "dissect/meaning/report/pdu_octets.py",
    "dissect/meaning/report/plus.py",
    "dissect/meaning/report/plus_items.py",
    "dissect/meaning/report/plus_octets.py",
    "dissect/meaning/report/servers.py",
    "dissect/meaning/report/tree.py",
    "dissect/meaning/report/tree_fields.py",
    "dissect/meaning/report/words.py",
    "dissect/meaning/report/writer.py",
    "dissect/meaning/report/writers/csv.py",
    "dissect/meaning/report/writers/jsonl.py",
    "dissect/meaning/report/writers/text.py",
    "dissect/output/variables/*.py",
)

#: What of these stays interpreted although it is imported by them: tables and layouts, which are made once and looked up
#: in, and what parses acts that are rare on any line. Compiled, they would take a third of the build and save nothing that can
#: be measured (docs/decisions/0002-one-source-compiled-by-mypyc.md says how to measure it).
COLD: Final = (
    "dissect/**/tables.py",
    "dissect/**/*_tables.py",
    "dissect/protocols/iso/build.py",  # what no capture needs
    "dissect/protocols/s7/build.py",
    "dissect/protocols/iso/layouts.py",  # ibh/layouts.py derives from a compiled class, which interpreted classes may not
    "dissect/protocols/s7/layouts.py",
    "dissect/**/*_layouts.py",
    "dissect/engine/findings/block_rules.py",
    "dissect/engine/findings/catalogue.py",
    "dissect/engine/findings/code_rules.py",
    "dissect/engine/findings/mitre.py",
    "dissect/engine/findings/operation_rules.py",
    "dissect/engine/findings/tls_rules.py",
    "dissect/protocols/iso/foreign.py",
    "dissect/protocols/s7/alarms.py",
    "dissect/protocols/s7/block_names.py",
    "dissect/protocols/s7/blocks.py",
    "dissect/protocols/s7/clock.py",
    "dissect/protocols/s7/control.py",
    "dissect/protocols/s7/cyclic.py",
    "dissect/protocols/s7/errors.py",
    "dissect/protocols/s7/hiding.py",
    "dissect/protocols/s7/nc.py",
    "dissect/protocols/s7/pbc.py",
    "dissect/protocols/s7/programmer.py",
    "dissect/protocols/s7/security.py",
    "dissect/protocols/s7/services.py",
    "dissect/protocols/s7/start_information.py",
    "dissect/protocols/s7/syntaxes.py",
    "dissect/protocols/s7/szl_communication.py",
    "dissect/protocols/s7/szl_modules.py",
    "dissect/protocols/s7/szl_records.py",
    "dissect/protocols/s7/transfer.py",
    "dissect/engine/transactions/items.py",
    "dissect/output/variables/choosing.py",
    "dissect/output/variables/reading.py",
    "dissect/output/variables/summary.py",
    "dissect/wire/copies.py",
    "dissect/wire/errors.py",
)

#: Of what is compiled, where most instructions are spent, in a seventh of the C lines. A fast build optimizes these,
#: the next ones less, and the rest not at all: most of the C compiler's work is optimizing
#: (docs/decisions/0002-one-source-compiled-by-mypyc.md).
BUSIEST: Final = (
    "dissect/wire/codes.py",
    "dissect/wire/digits.py",
    "dissect/wire/layout.py",
    "dissect/wire/octets.py",
    "dissect/wire/text.py",
    "dissect/packets/source/pcap.py",
    "dissect/packets/source/pcapng.py",
    "dissect/packets/tcp/usual.py",
    "dissect/engine/iso.py",
    "dissect/engine/pipeline.py",
    "dissect/engine/s7.py",
    "dissect/protocols/s7/parameters.py",
    "dissect/protocols/s7/singles.py",
    "dissect/protocols/s7/values.py",
    "dissect/engine/transactions/checks.py",
    "dissect/engine/transactions/gaps.py",
    "dissect/engine/transactions/good_items.py",
    "dissect/engine/transactions/open_requests.py",
    "dissect/engine/transactions/pairing.py",
    "dissect/engine/transactions/side.py",
    "dissect/engine/transactions/table.py",
    "dissect/engine/transactions/transaction.py",
    "dissect/meaning/report/item_json.py",
    "dissect/meaning/report/latencies.py",
    "dissect/meaning/report/plus_octets.py",
    "dissect/meaning/report/writers/jsonl.py",
    "dissect/files/jobs/spots.py",
    "dissect/engine/plus.py",
    "dissect/engine/findings/explaining.py",
    "dissect/engine/findings/plus_rules.py",
    "dissect/protocols/s7plus/blobs.py",
    "dissect/protocols/s7plus/events.py",
    "dissect/protocols/s7plus/message.py",
    "dissect/protocols/s7plus/plain.py",
    "dissect/protocols/s7plus/check.py",
    "dissect/protocols/s7plus/checked.py",
    "dissect/protocols/s7plus/cursor.py",
    "dissect/protocols/s7plus/event.py",
    "dissect/protocols/s7plus/objects.py",
    "dissect/protocols/s7plus/session.py",
    "dissect/protocols/s7plus/walk.py",
    "dissect/engine/exchange.py",
    "dissect/engine/findings/reporter.py",
    "dissect/engine/transactions/plus_operations.py",
)

#: What else a packet or a transaction of any protocol passes through.
BUSY: Final = (
    "dissect/files/anonymize/checksum.py",
    "dissect/files/anonymize/masked.py",
    "dissect/files/anonymize/messages.py",
    "dissect/files/anonymize/rewrite_plan.py",
    "dissect/files/anonymize/rewriter.py",
    "dissect/files/anonymize/rules.py",
    "dissect/files/anonymize/survey.py",
    "dissect/files/anonymize/track.py",
    "dissect/files/anonymize/usual_packet.py",
    "dissect/testing/golden/usual.py",
    "dissect/wire/hexdump.py",
    "dissect/wire/malformed.py",
    "dissect/wire/part.py",
    "dissect/packets/source/packet.py",
    "dissect/packets/source/packet_blocks.py",
    "dissect/packets/source/ring_blocks.py",
    "dissect/packets/tcp/connection.py",
    "dissect/packets/tcp/stream.py",
    "dissect/protocols/iso/cotp.py",
    "dissect/protocols/iso/recognition.py",
    "dissect/protocols/iso/tpkt.py",
    "dissect/protocols/iso/tsap.py",
    "dissect/protocols/iso/upper.py",
    "dissect/protocols/s7/items.py",
    "dissect/protocols/s7/message.py",
    "dissect/protocols/s7/szl.py",
    "dissect/protocols/s7plus/assembly.py",
    "dissect/protocols/s7plus/bodies.py",
    "dissect/protocols/s7plus/grammar.py",
    "dissect/protocols/s7plus/hiding.py",
    "dissect/protocols/s7plus/ids.py",
    "dissect/protocols/s7plus/items.py",
    "dissect/protocols/s7plus/notifications.py",
    "dissect/protocols/s7plus/parameters.py",
    "dissect/protocols/s7plus/pieces.py",
    "dissect/protocols/s7plus/sameness.py",
    "dissect/protocols/s7plus/cursor_lists.py",
    "dissect/protocols/s7plus/summary.py",
    "dissect/protocols/s7plus/value_showing.py",
    "dissect/engine/transactions/alike.py",
    "dissect/engine/transactions/connection.py",
    "dissect/engine/transactions/ending.py",
    "dissect/engine/findings/plus_sessions.py",
    "dissect/engine/findings/scan_rules.py",
    "dissect/engine/findings/station_rules.py",
    "dissect/engine/findings/transaction_rules.py",
    "dissect/engine/findings/transport_rules.py",
    "dissect/engine/connections.py",
    "dissect/engine/timers.py",
    "dissect/output/export/item_columns.py",
    "dissect/output/export/pdu_columns.py",
    "dissect/output/export/transaction_rows.py",
    "dissect/output/export/value_columns.py",
    "dissect/files/recording/cutter.py",
    "dissect/files/recording/recent.py",
    "dissect/meaning/report/analysis.py",
    "dissect/meaning/report/facets.py",
    "dissect/meaning/report/json_page.py",
    "dissect/meaning/report/pdu_json.py",
    "dissect/meaning/report/plus.py",
    "dissect/meaning/report/plus_items.py",
    "dissect/meaning/report/tree.py",
    "dissect/meaning/report/tree_fields.py",
    "dissect/meaning/report/writer.py",
    "dissect/meaning/report/item_octets.py",
    "dissect/meaning/report/line_octets.py",
    "dissect/meaning/report/writers/csv.py",
    "dissect/meaning/report/writers/text.py",
    "dissect/protocols/s7/bodies.py",
    "dissect/protocols/s7/data_parts.py",
    "dissect/output/variables/collector.py",
    "dissect/output/variables/model.py",
    "dissect/output/variables/tracker.py",
    "dissect/engine/stations/evidence.py",
    "dissect/engine/stations/facts.py",
    "dissect/engine/acts/act.py",
    "dissect/engine/acts/book.py",
    "dissect/engine/acts/plus.py",
    "dissect/engine/findings/bounds.py",
    "dissect/engine/findings/ledger.py",
    "dissect/engine/findings/security_rules.py",
    "dissect/protocols/s7plus/loads.py",
    "dissect/protocols/s7plus/states.py",
    "dissect/protocols/s7plus/variables.py",
    "dissect/engine/transactions/plus_loads.py",
    "dissect/wire/varint.py",
    "dissect/protocols/s7plus/check_response.py",
    "dissect/protocols/s7plus/contents.py",
    "dissect/protocols/s7plus/ending.py",
    "dissect/protocols/s7plus/program.py",
    "dissect/protocols/s7plus/read_objects.py",
    "dissect/protocols/s7plus/reads.py",
    "dissect/protocols/s7plus/value_reading.py",
    "dissect/protocols/s7plus/values.py",
    "dissect/protocols/s7plus/writes.py",
    "dissect/engine/transactions/operation.py",
    "dissect/engine/transactions/results.py",
)

#: The commands that need the extensions; metadata and editable installs do not (a compiled copy would hide later edits).
BUILDING: Final = frozenset(("bdist", "bdist_wheel", "build", "build_ext", "install"))

#: When everything in an archive was written, unless SOURCE_DATE_EPOCH says otherwise: 1980, before which no wheel can be.
EPOCH: Final = "315532800"

#: The library of all compiled modules, as mypyc names it.
LIBRARY: Final = "s7dissect__mypyc"
#: What is there for each of its modules, for Python to find it.
SHIM: Final = "scripts/shim.c"

#: How many C compilers run side by side.
JOBS: Final = os.cpu_count() or 1

#: How many C files a build makes of each kind: as few as keep two processors at work, for each reads the same long
#: headers.
PARTS: Final = 2
#: How each kind is compiled, by how the names of its files begin. -Og is half the work of -O1. Glibc's checks of buffers want
#: an optimizing compiler, and complain of any other.
FAST: Final = {
    "busiest": ("-finline-small-functions",),  # that much more than mypyc asks for; it costs no time
    "busy": ("-Og",),
    "plain": ("-O0", "-U_FORTIFY_SOURCE"),
}
#: The same for a release, where mypyc asks for -O3. What is no hot module is not worth the minutes.
RELEASED: Final = {"busiest": (), "busy": (), "plain": ("-O1",)}

#: What a release does between its two builds, with the first one.
TRAINING: Final = "scripts/train.py"
#: How the two are compiled: each file counts what it runs, beside its object file, and is then compiled with these counts. To
#: link all files as one (-flto) gave 2 % fewer instructions and took as long or longer.
COUNTING: Final = ("-fprofile-generate",)
COUNTED: Final = ("-fprofile-use",)


def is_release() -> bool:
    """Return whether a release is built."""
    return os.environ.get("S7DISSECT_RELEASE") == "1"


def interpreted(reason: str) -> list[Extension]:
    """Return what is compiled when nothing is; say so and why, or end the build where it must not happen."""
    if os.environ.get("S7DISSECT_COMPILED") == "1":
        message = f"s7dissect: the engine cannot be compiled, and S7DISSECT_COMPILED=1 demands it: {reason}"
        raise SystemExit(message)
    print(f"s7dissect: the engine is NOT compiled and runs interpreted, slower: {reason}", file=sys.stderr)
    return []


def hot_modules() -> list[str]:
    """Return the paths of the modules to compile; a package's ``__init__`` is never one of them."""
    hot, cold = ({path for pattern in patterns for path in Path().glob(pattern)} for patterns in (HOT, COLD))
    return sorted(path.as_posix() for path in hot - cold if path.name != "__init__.py")


def compiler_trouble() -> str:
    """Return why C extensions cannot be built here, or an empty string."""
    if sys.implementation.name != "cpython":
        return f"mypyc compiles for CPython, not for {sys.implementation.name}"
    compiler = new_compiler()
    customize_compiler(compiler)
    with tempfile.TemporaryDirectory() as directory:
        source = Path(directory, "probe.c")
        source.write_text("#include <Python.h>\nint probe(void) { return PY_VERSION_HEX != 0; }\n", encoding="ascii")
        try:
            compiler.compile([str(source)], output_dir=directory, include_dirs=[get_python_inc()])
        except Exception:  # noqa: BLE001 - every compiler class has errors of its own
            name = getattr(compiler, "compiler", ["cc"])[0]
            return f"the C compiler {name!r} is missing or does not find Python's headers"
    return ""


def kind(source: str) -> str:
    """Return how a C file of the library is compiled (`FAST`): that of a module, or of mypyc's own library."""
    module = Path(source).name.removeprefix("__native_").removesuffix(".c").replace("___", "/") + ".py"
    if not module.startswith("dissect/") or any([Path(module).match(pattern) for pattern in BUSIEST]):
        return "busiest"
    return "busy" if any([Path(module).match(pattern) for pattern in BUSY]) else "plain"


def share_shim(shims: list[Extension]) -> None:
    """Let one C file make every module of the library importable; mypyc writes one for each, which all have to be compiled."""
    names = sorted({extension.name.rpartition(".")[2] for extension in shims})
    modules = " ".join([f"MODULE({name})" for name in names])
    Path("build", "modules.h").write_text(f'#define LIBRARY "{LIBRARY}"\n#define MODULES {modules}\n', encoding="ascii")
    for extension in shims:
        extension.sources = [SHIM]
        extension.include_dirs = ["build"]


def united(sources: list[str], name: str, count: int) -> list[str]:
    """Return C files that include the sources, ``count`` of about the same size, the same for every build."""
    parts: list[list[str]] = [[] for _ in range(count)]
    sizes = [0] * count
    for source in sorted(sources, key=lambda name: (-Path(name).stat().st_size, name)):
        smallest = sizes.index(min(sizes))
        sizes[smallest] += Path(source).stat().st_size
        parts[smallest].append(source)
    files = [Path(sources[0]).with_name(f"{name}_{number}.c") for number in range(count)]
    for file, part in zip(files, parts, strict=True):
        lines = [f'#include "{Path(source).relative_to(file.parent).as_posix()}"\n' for source in sorted(part)]
        file.write_text("".join(lines), encoding="utf-8")
    return [str(file) for file in files]


def extensions() -> list[Extension]:
    """Return the compiled form of the hot modules, empty (and said so) where they cannot be compiled."""
    if os.environ.get("S7DISSECT_COMPILED") == "0":
        return interpreted("asked for with S7DISSECT_COMPILED=0")
    trouble = compiler_trouble()
    if trouble:
        return interpreted(trouble)
    try:
        from mypyc.build import mypycify

        compiled = mypycify(
            # No configuration file and no complaint about modules that are only looked at: what mypy demands of the code
            # is asked in the tests, with everything installed; a build needs the types alone.
            # Nor does it depend on what else is installed.
            [
                "--config-file=",
                f"--cache-dir={os.devnull}",
                "--follow-imports=silent",
                "--no-site-packages",
                *hot_modules(),
            ],
            opt_level="3" if is_release() else "1",
            debug_level="0",
            multi_file=True,
            group_name="s7dissect",
        )
    except (Exception, SystemExit) as exc:  # noqa: BLE001 - mypycify ends the process when it rejects a module
        return interpreted(f"mypyc failed ({type(exc).__name__}: {exc}; what it printed is above)")
    shims = [extension for extension in compiled if extension.name != LIBRARY]
    if shims and not sysconfig.get_config_var("Py_GIL_DISABLED"):
        share_shim(shims)
    for extension in compiled:
        extension.optional = True
        for source in extension.sources:
            keep_docs(source)
        if len(extension.sources) > PARTS * len(FAST):
            kinds = {name: [source for source in extension.sources if kind(source) == name] for name in FAST}
            extension.sources = [part for name, sources in kinds.items() for part in united(sources, name, PARTS)]
        if new_compiler().compiler_type == "unix":
            # Without these the engine's functions could be replaced from outside, so that none of them may be inlined into
            # another, and each call from one C file to another would go through a table. What Python looks for is exported
            # all the same. What the interpreter has is called without a stub between.
            hidden = ("-fno-semantic-interposition", "-fvisibility=hidden", "-fno-plt")
            # Nobody reads what a compiler would say of generated code, and to look for it is a sixth of its work.
            extension.extra_compile_args = [*extension.extra_compile_args, *hidden, "-w"]
    return compiled


#: What the attributes of public classes are.
ATTRIBUTES: Final = "dissect/wire/attribute_tables.py"
#: How the signature of a method ends in C.
DOC_END: Final = '")},'


def keep_docs(source: str) -> None:
    """Write the docstrings that mypyc leaves out, of classes, methods and properties, into a C file, for ``help``."""
    path = Path(source)
    module = path.name.removeprefix("__native_").removesuffix(".c").replace("___", ".")
    if not Path(*module.split(".")).with_suffix(".py").is_file():
        return  # of mypyc's own library
    docs, owner, name = docs_of(module), "", ""
    lines = path.read_text(encoding="utf-8").split("\n")
    for number, line in enumerate(lines):
        if table := re.match(r"static Py(?:GetSet|Method)Def (\w+?)_?(?:getseters|methods)\[\] = ", line):
            owner = "" if table[1].endswith("module") else table[1].split("___")[-1]
        elif kind := re.match(r' *\.tp_name = "(\w+)",', line):
            owner, name = kind[1], ""
        elif entry := re.match(r' *\{"(\w+)",', line):
            name = entry[1]
        said = docs.get((owner, name), "")
        if said and line.endswith("NULL, NULL},"):
            lines[number] = f'{line.removesuffix("NULL, NULL},")}PyDoc_STR("{c_text(said)}"), NULL}},'
        elif said and "PyDoc_STR(" in line and line.endswith('\\n--\\n\\n")},'):
            lines[number] = f"{line.removesuffix(DOC_END)}{c_text(said)}{DOC_END}"
        elif said and (head := re.match(r' *\.tp_doc = PyDoc_STR\((?:NULL|(".*)")\),', line)):
            lines[number] = f'    .tp_doc = PyDoc_STR({head[1] or chr(34)}{c_text(said)}"),'
            owner = ""
    path.write_text("\n".join(lines), encoding="utf-8")


@cache
def docs_of(module: str) -> dict[tuple[str, str], str]:
    """Return the docstrings of a module's functions, methods and attributes, by class (empty for none) and name.

    That of a class itself has an empty name.
    """
    found: dict[tuple[str, str], str] = {}
    attributes = runpy.run_path(ATTRIBUTES)["ATTRIBUTES"]
    tree = ast.parse(Path(*module.split(".")).with_suffix(".py").read_text(encoding="utf-8"))
    for owner in [tree, *[node for node in tree.body if isinstance(node, ast.ClassDef)]]:
        for node in owner.body:
            if isinstance(node, ast.FunctionDef):
                name = owner.name if isinstance(owner, ast.ClassDef) else ""
                found.setdefault((name, node.name), ast.get_docstring(node) or "")
        if isinstance(owner, ast.ClassDef):
            found[owner.name, ""] = ast.get_docstring(owner) or ""
            found.update({(owner.name, name): said for name, said in attributes.get(owner.name, {}).items()})
    return found


def c_text(text: str) -> str:
    """Return a text for a literal of C, in octal where it is not plain."""
    plain = frozenset(range(32, 127)) - frozenset(b'"\\?')
    return "".join([chr(octet) if octet in plain else f"\\{octet:03o}" for octet in text.encode()])


class AllOrNothing(build_ext):
    """Builds every extension, several side by side, or leaves none behind: half an engine would not import."""

    def build_extensions(self) -> None:
        """Build; if one extension failed (setuptools has warned of it), remove the others and say so."""
        outputs = {extension.name: Path(self.get_ext_fullpath(extension.name)) for extension in self.extensions}
        if self.compiler.compiler_type == "unix":
            self.parallel = JOBS
            self.compiler.compile = SideBySide(self.compiler.compile)
        every = self.extensions
        shims = [extension for extension in every if extension.sources == [SHIM]]
        self.extensions = [extension for extension in every if extension not in shims[1:]]
        library = [extension for extension in every if extension.name == LIBRARY]
        if library and is_release() and not self.inplace and is_gcc(self.compiler):
            self._count(library[0], shims, outputs)
        super().build_extensions()
        self.extensions = every
        _copy_shim(shims, outputs)
        failed = [name for name, path in outputs.items() if not path.exists()]
        if failed:
            for path in outputs.values():
                path.unlink(missing_ok=True)
            interpreted(f"the C compiler failed on {', '.join(failed)}")

    def _count(self, library: Extension, shims: list[Extension], outputs: dict[str, Path]) -> None:
        """Build once so that the library counts what it runs, run it, and have the next build use that."""
        asked = list(library.extra_compile_args)
        library.extra_compile_args = [*asked, *COUNTING]
        library.extra_link_args = list(COUNTING)
        super().build_extensions()
        _copy_shim(shims, outputs)
        if all(path.exists() for path in outputs.values()):
            train(Path(self.build_lib))
        for path in outputs.values():
            path.unlink(missing_ok=True)  # where the next build fails, one that counts must not be taken for it
        library.extra_compile_args = [*asked, *COUNTED]
        library.extra_link_args = []


def _copy_shim(shims: list[Extension], outputs: dict[str, Path]) -> None:
    if shims and outputs[shims[0].name].exists():
        for extension in shims[1:]:
            outputs[extension.name].parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(outputs[shims[0].name], outputs[extension.name])


def is_gcc(compiler: Any) -> bool:
    """Return whether a compiler is gcc; clang counts in files of another kind."""
    command = getattr(compiler, "compiler", None)
    if not command:
        return False
    said = subprocess.run([*command, "--version"], capture_output=True, text=True, check=False).stdout
    return "Free Software Foundation" in said


def importing(folder: Path) -> dict[str, str]:
    """Return the environment of a process that imports the package in a folder, whatever else is installed."""
    path = os.pathsep.join([name for name in (str(folder.resolve()), os.environ.get("PYTHONPATH")) if name])
    return {**os.environ, "PYTHONPATH": path}


def train(library: Path) -> None:
    """Run what a release is to be quick at, with the package in ``library``; where that fails, end the build."""
    print("s7dissect: counting what the engine runs", file=sys.stderr)
    ran = subprocess.run([sys.executable, "-P", TRAINING], env=importing(library), check=False)
    if ran.returncode:
        message = f"s7dissect: {TRAINING} failed, so that a release cannot be compiled for speed"
        raise SystemExit(message)


class SideBySide:
    """A compiler's method ``compile`` that starts one process per source; setuptools compiles an extension's in turn."""

    def __init__(self, compile_all: Any) -> None:
        self.compile_all = compile_all

    def __call__(self, sources: list[str], **options: Any) -> list[str]:
        """Compile; the objects come in the order of the sources, so that the library is the same each time."""
        with ThreadPoolExecutor(JOBS) as pool:
            return [objects[0] for objects in pool.map(lambda source: self._compile(source, options), sources)]

    def _compile(self, source: str, options: dict[str, Any]) -> list[str]:
        flags = (RELEASED if is_release() else FAST).get(Path(source).name.rpartition("_")[0], ())
        if flags:
            options = {**options, "extra_postargs": [*(options.get("extra_postargs") or []), *flags]}
        objects: list[str] = self.compile_all([source], **options)
        return objects


def man_pages() -> list[str]:
    """Return the pages of `man`, made from the commands; none, and say why, where what that takes is missing."""
    folder = Path("build", "man1")
    shutil.rmtree(folder, ignore_errors=True)
    # In a process of its own, from the sources: what is installed may be older.
    program = [sys.executable, "scripts/man_pages.py", str(folder)]
    ran = subprocess.run(program, env=importing(Path()), capture_output=True, text=True, check=False)
    if ran.returncode:
        reason = (ran.stderr.strip() or "no reason given").rsplit("\n", 1)[-1]
        print(f"s7dissect: the pages of man are NOT built: {reason}", file=sys.stderr)
        return []
    return sorted(page.as_posix() for page in folder.glob("*.1"))


class WithManual(build_py):
    """Packs the pages of docs/ into the package, where `s7dissect help` finds them, and adds the pages of `man`."""

    pages: Callable[[], list[str]] = staticmethod(man_pages)

    def run(self) -> None:
        """Build the package, then add the pages."""
        super().run()
        self.distribution.data_files = [("share/man/man1", self.pages())]
        if self.editable_mode:
            return  # the pages are found where they are
        folder = Path(self.build_lib, "dissect", "help")
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        for page in sorted(Path("docs").glob("*.md")):
            shutil.copyfile(page, folder / page.name)
        usual_modes(Path(self.build_lib))


class SameWheel(bdist_wheel):
    """Packs the wheel so that the umask of whoever checked the sources out leaves no trace in it."""

    def write_wheelfile(self, wheelfile_base: str, *arguments: Any, **options: Any) -> None:
        """Write what says how the wheel was built, the last of its metadata."""
        super().write_wheelfile(wheelfile_base, *arguments, **options)
        usual_modes(Path(wheelfile_base))


def usual_modes(folder: Path) -> None:
    """Give what is in a folder the modes that it has for nearly everybody: an archive keeps them."""
    for path in folder.rglob("*"):
        path.chmod(0o755 if path.is_dir() or path.stat().st_mode & 0o100 else 0o644)


class SameArchive(sdist):
    """Packs the source distribution so that the same files give the same bytes: whoever builds it, when and where."""

    def make_archive(self, base_name: str, format: str, *arguments: Any, **options: Any) -> str:  # noqa: A002 - its name there
        """Pack ``base_dir``; kinds of archives other than the usual one are left to setuptools."""
        if format != "gztar":
            made: str = super().make_archive(base_name, format, *arguments, **options)
            return made
        folder = Path(options["base_dir"])
        name, when = f"{base_name}.tar.gz", int(os.environ["SOURCE_DATE_EPOCH"])
        with (
            Path(name).open("wb") as file,
            gzip.GzipFile("", "wb", 9, file, when) as packed,
            tarfile.open(fileobj=packed, mode="w", format=tarfile.PAX_FORMAT) as archive,
        ):
            for path in sorted([folder, *folder.rglob("*")], key=Path.as_posix):
                archive.add(path, path.as_posix(), recursive=False, filter=_nobodys)
        return name


def _nobodys(entry: tarfile.TarInfo) -> tarfile.TarInfo:
    """Take away from an entry of an archive whose it is, when it was written and what the umask made of its mode."""
    entry.mtime = int(os.environ["SOURCE_DATE_EPOCH"])
    entry.uid, entry.gid, entry.uname, entry.gname = 0, 0, "", ""
    entry.mode = 0o755 if entry.isdir() or entry.mode & 0o100 else 0o644
    return entry


#: What is done in our way of what setuptools can do.
COMMANDS: Final = {
    "bdist_wheel": SameWheel,
    "build_ext": AllOrNothing,
    "build_py": WithManual,
    "sdist": SameArchive,
}


def build() -> None:
    """Run setuptools."""
    os.environ.setdefault("SOURCE_DATE_EPOCH", EPOCH)
    os.umask(0o022)
    if not BUILDING.isdisjoint(sys.argv):
        # setuptools packs whatever an earlier build left here, modules that are gone or no longer compiled included.
        for stale in Path("build").glob("lib*"):
            shutil.rmtree(stale)
        # The pages of `man` are made beside mypyc, which keeps one processor busy.
        with ThreadPoolExecutor(1) as beside:
            WithManual.pages = beside.submit(man_pages).result
            setup(ext_modules=extensions(), cmdclass=COMMANDS)
    else:
        setup(cmdclass=COMMANDS)


if __name__ == "__main__":
    build()
