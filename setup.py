"""Build the package: the hot modules compiled with mypyc where that is possible, interpreted where it is not.

Everything declarative stands in pyproject.toml. A build that cannot compile is no failed build: it prints one line that says
why, and the package runs the same source interpreted. ``S7DISSECT_INTERPRETED=1`` asks for that on purpose. (pip shows what a
build prints only with ``-v``; ``s7dissect --version`` tells what was installed.)
"""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Final

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext

# Only importable once setuptools has put its own copy in place.
from distutils.ccompiler import new_compiler  # isort: skip
from distutils.sysconfig import customize_compiler, get_python_inc  # isort: skip

#: The modules on the way of every octet. They import the standard library, mypy_extensions and each other, nothing else.
HOT: Final = (
    "dissect/wire/*.py",
    "dissect/source/packet.py",
    "dissect/source/pcap.py",
    "dissect/source/pcapng.py",
    "dissect/tcp/*.py",
    "dissect/iso/*.py",
    "dissect/ibh/*.py",
    "dissect/s7/*.py",
    "dissect/s7plus/*.py",
    "dissect/transactions/*.py",
    "dissect/findings/*.py",
    "dissect/engine/conversation.py",
    "dissect/engine/udp.py",
    "dissect/engine/timers.py",
    "dissect/engine/ibh.py",
    "dissect/engine/pipeline.py",
    "dissect/report/analysis.py",
    "dissect/report/json_text.py",
    "dissect/report/jsonl.py",
    "dissect/report/latency.py",
)

#: What of these stays interpreted: tables and layouts, which are made once when somebody looks at a body. Compiled, making
#: them would be no faster, and the build would take half as long again.
COLD: Final = frozenset(
    (
        "dissect/s7/diagnostic_tables.py",
        "dissect/s7/programmer_layouts.py",
        "dissect/s7/start_information.py",
        "dissect/s7/szl_communication.py",
        "dissect/s7/szl_modules.py",
        "dissect/s7/szl_records.py",
        "dissect/s7/szl_tables.py",
        "dissect/s7plus/id_tables.py",
        "dissect/s7plus/program_tables.py",
        "dissect/s7plus/return_tables.py",
    )
)

#: The commands that need the extensions; metadata and editable installs do not (a compiled copy would hide later edits).
BUILDING: Final = frozenset(("bdist", "bdist_wheel", "build", "build_ext", "install"))


def say_interpreted(reason: str) -> None:
    """Print the one line that tells that the engine is not compiled, and why."""
    print(f"s7dissect: the engine is NOT compiled and runs interpreted, slower: {reason}", file=sys.stderr)


def hot_modules() -> list[str]:
    """Return the paths of the modules to compile; a package's ``__init__`` is never one of them."""
    paths = (path for pattern in HOT for path in Path().glob(pattern))
    return sorted(path.as_posix() for path in paths if path.name != "__init__.py" and path.as_posix() not in COLD)


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


def extensions() -> list[Extension]:
    """Return the compiled form of the hot modules, empty (and told so) where there is no compiling them."""
    if os.environ.get("S7DISSECT_INTERPRETED") == "1":
        say_interpreted("asked for with S7DISSECT_INTERPRETED=1")
        return []
    trouble = compiler_trouble()
    if trouble:
        say_interpreted(trouble)
        return []
    try:
        from mypyc.build import mypycify

        compiled = mypycify(
            # No configuration file and no complaint about modules that are only looked at: what mypy demands of the code
            # is asked in the tests, with everything installed; a build needs the types alone.
            ["--config-file=", f"--cache-dir={os.devnull}", "--follow-imports=silent", *hot_modules()],
            opt_level="3",
            group_name="s7dissect",
        )
    except (Exception, SystemExit) as exc:  # noqa: BLE001 - mypycify ends the process when it rejects a module
        say_interpreted(f"mypyc failed ({type(exc).__name__}: {exc}; what it said stands above)")
        return []
    for extension in compiled:
        extension.optional = True
        if new_compiler().compiler_type == "unix":
            # The whole engine is one C file; without this its functions could be replaced from outside, so that none of
            # them may be inlined into another.
            extension.extra_compile_args.append("-fno-semantic-interposition")
    return compiled


class AllOrNothing(build_ext):
    """Builds every extension or leaves none behind: half an engine would not import."""

    def build_extensions(self) -> None:
        """Build; when one extension failed (setuptools has warned of it), remove the others and say so."""
        outputs = {extension.name: Path(self.get_ext_fullpath(extension.name)) for extension in self.extensions}
        super().build_extensions()
        failed = [name for name, path in outputs.items() if not path.exists()]
        if failed:
            for path in outputs.values():
                path.unlink(missing_ok=True)
            say_interpreted(f"the C compiler failed on {', '.join(failed)}")


def build() -> None:
    """Run setuptools."""
    if not BUILDING.isdisjoint(sys.argv):
        # setuptools packs whatever an earlier build left here, modules that are gone or no longer compiled included.
        for stale in Path("build").glob("lib*"):
            shutil.rmtree(stale)
        setup(ext_modules=extensions(), cmdclass={"build_ext": AllOrNothing})
    else:
        setup()


build()
