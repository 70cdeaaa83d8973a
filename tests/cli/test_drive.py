"""What every analysing command does alike: input, exit codes, interruption, safety of output, determinism, terminal."""

from __future__ import annotations

import csv
import errno
import fcntl
import gzip
import io
import json
import os
import re
import shutil
import signal
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import pytest

from dissect.cli.display import write_lines
from dissect.cli.main import EXIT_DAMAGED, EXIT_GATE, EXIT_INTERRUPTED, EXIT_OK, EXIT_OUTPUT, EXIT_USAGE, group
from dissect.cli.run import Bar
from dissect.meaning.report.styled import Line
from tests.cli.support import halves, large, on_terminal, run, simple, started
from tests.cli.test_outputs import commands
from tests.forked import Forked
from tests.meaning.report.schemas import complaints
from tests.meaning.report.support import ROOT, UNSAFE, read, saved
from tests.properties import messages
from tests.properties.messages import Item, dt
from tests.properties.packets import Flow, Packet, Talk

if TYPE_CHECKING:
    from tests.conftest import Command

COMMANDS = ("analyze", "transactions", "show")
#: Every face, as arguments.
FACES = (
    ("analyze",),
    ("analyze", "-T", "json"),
    ("transactions",),
    ("transactions", "-T", "jsonl"),
    ("transactions", "-T", "csv"),
    ("show",),
    ("show", "-V"),
    ("show", "-T", "jsonl"),
)
STYLES = re.compile("\x1b\\[[0-9;]*m")

Capture = pytest.CaptureFixture[bytes]


@pytest.fixture
def good(tmp_path: Path) -> Path:
    return simple(tmp_path / "good.pcapng")


@pytest.fixture
def cut(tmp_path: Path, good: Path) -> Path:
    path = tmp_path / "cut.pcapng"
    path.write_bytes(good.read_bytes()[:-30])
    return path


# ---- exit codes -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", COMMANDS)
def test_0_when_all_is_well(s7dissect: Command, good: Path, command: str) -> None:
    ran = s7dissect(command, good)
    assert (ran.returncode, ran.stderr) == (0, b"")
    assert ran.stdout


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("gone.pcap", None, "no such file"),
        ("empty.pcap", b"", "empty"),
        (
            "notes.pcap",
            b"These are notes, no capture.",
            "not a capture file (pcap or pcapng, plain or in gzip or zstd)",
        ),
        ("short.pcap", b"\xd4\xc3", "only 2 bytes, not a capture"),
    ],
)
def test_2_when_there_is_nothing_to_read(
    capfdbinary: Capture, tmp_path: Path, command: str, name: str, content: bytes | None, said: str
) -> None:
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    ran = run(capfdbinary, command, path)
    assert (ran.code, ran.out, ran.err) == (2, "", f"s7dissect: {path}: {said}\n")


def test_no_command_looks_for_rights_before_it_reads() -> None:
    """It would be several lines about the use, also of a file among others that can be read (``--separate``)."""
    types = [param.type for command in commands().values() for param in command.params]
    paths = [type_ for type_ in types if isinstance(type_, click.Path)]
    assert len(paths) > 30
    assert not [path for path in paths if path.readable]


@pytest.mark.parametrize("command", COMMANDS)
def test_2_when_there_is_no_right_to_read(
    capfdbinary: Capture, good: Path, monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    opened, access = Path.open, os.access

    def refuse(path: Path, *given: Any, **named: Any) -> Any:
        if path == good:
            raise PermissionError(13, "Permission denied", str(path))
        return opened(path, *given, **named)

    def ask(path: Any, *given: Any, **named: Any) -> bool:
        return str(path) != str(good) and access(path, *given, **named)

    monkeypatch.setattr(Path, "open", refuse)
    monkeypatch.setattr(os, "access", ask)
    ran = run(capfdbinary, command, good)
    assert (ran.code, ran.out, ran.err) == (2, "", f"s7dissect: {good}: no permission to read it\n")


@pytest.mark.parametrize("command", COMMANDS)
def test_2_when_a_name_is_empty(capfdbinary: Capture, command: str) -> None:
    """As that of a variable of the shell that was not set; it does not stand for the folder where one is."""
    ran = run(capfdbinary, command, "")
    said = "s7dissect: the name of a file is empty; was a variable of the shell not set?\n"
    assert (ran.code, ran.out, ran.err) == (2, "", said)


@pytest.mark.parametrize("command", COMMANDS)
def test_2_before_anything_is_written_when_one_of_several_is_wrong(
    capfdbinary: Capture, good: Path, command: str
) -> None:
    ran = run(capfdbinary, command, good, good.parent / "gone.pcap")
    assert (ran.code, ran.out) == (2, "")
    assert ran.err.endswith("gone.pcap: no such file\n")


@pytest.mark.parametrize(
    "arguments",
    [["analyze"], ["show", "--frame", "0", "x"], ["transactions", "-T", "xml", "x"], ["analyze", "--slow", "-1", "x"]],
)
def test_2_on_wrong_use(capfdbinary: Capture, arguments: list[str]) -> None:
    ran = run(capfdbinary, *arguments)
    assert (ran.code, ran.out) == (2, "")
    assert "Error: " in ran.err


@pytest.mark.parametrize("command", COMMANDS)
def test_3_when_the_file_is_cut_with_the_results_until_there(s7dissect: Command, cut: Path, command: str) -> None:
    ran = s7dissect(command, cut)
    assert ran.returncode == 3
    assert ran.stderr.decode().startswith(f"s7dissect: {cut}: cut off at byte ")
    assert ran.stderr.count(b"\n") == 1
    whole = s7dissect(command, cut.with_name("good.pcapng")).stdout
    assert ran.stdout
    if command != "analyze":
        assert all(line in whole for line in ran.stdout.splitlines()[:-1])


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
@pytest.mark.parametrize("command", COMMANDS)
def test_5_when_the_output_cannot_be_written(s7dissect: Command, good: Path, command: str) -> None:
    with Path("/dev/full").open("wb") as full:
        ran = s7dissect(command, good, stdout=full.fileno())
    assert ran.returncode == 5
    assert ran.stderr == b"s7dissect: cannot write the results: No space left on device\n"


@pytest.mark.parametrize("command", COMMANDS)
def test_0_and_quiet_when_nobody_reads_on(s7dissect: Command, good: Path, command: str) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    try:
        ran = s7dissect(command, good, stdout=writer)
    finally:
        os.close(writer)
    assert (ran.returncode, ran.stderr) == (0, b"")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("arguments", [("analyze", "-T", "json"), ("analyze",), ("transactions",), ("show",)])
def test_130_when_interrupted_with_the_results_until_then(
    good: Path, number: signal.Signals, arguments: tuple[str, ...]
) -> None:
    with started(*arguments, "-") as process:
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdin.write(good.read_bytes())
        process.stdin.flush()
        # What streams shows that all was read; an analysis says nothing before its end.
        first = process.stdout.readline() if arguments[0] != "analyze" else _reads_all(process)
        process.send_signal(number)
        rest, complaint = process.stdout.read(), process.stderr.read()
        assert process.wait(120) == 130
    assert complaint == b"s7dissect: interrupted; the results cover what was read so far\n"
    told = (first + rest).decode()
    if "json" in arguments:
        analysis = json.loads(told)
        assert analysis["interrupted"] is True
        assert analysis["packets"]["read"] == 13
        assert complaints("analysis", analysis, exact=True) == []
    elif arguments == ("analyze",):
        assert "  INTERRUPTED: this report covers the packets read until then\n" in told
        assert told.endswith("\n  no gaps in the TCP streams\n")
    else:
        assert told.count("\n") == (4 if arguments == ("transactions",) else 10)


def _reads_all(process: Forked) -> bytes:
    """Wait until a process sleeps because its input has nothing more."""
    stat = Path(f"/proc/{process.pid}/stat")
    for _ in range(2400):
        time.sleep(0.05)
        if stat.read_text(encoding="ascii").rpartition(")")[2].split()[0] == "S" and _is_empty(process):
            return b""
    raise AssertionError("the process never came to rest")


def _is_empty(process: Forked) -> bool:
    assert process.stdin is not None
    (left,) = struct.unpack("i", fcntl.ioctl(process.stdin.fileno(), termios.FIONREAD, bytes(4)))
    return bool(left == 0)


# ---- input ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("arguments", FACES)
def test_a_file_a_pipe_and_a_compressed_file_give_the_same(
    s7dissect: Command, good: Path, arguments: tuple[str, ...]
) -> None:
    packed = good.with_suffix(".gz")
    packed.write_bytes(gzip.compress(good.read_bytes(), mtime=0))
    whole = s7dissect(*arguments, good).stdout
    assert s7dissect(*arguments, "-", stdin=good.read_bytes()).stdout.replace(b"stdin", str(good).encode()) == whole
    assert s7dissect(*arguments, "-", stdin=packed.read_bytes()).stdout.replace(b"stdin", str(good).encode()) == whole
    assert s7dissect(*arguments, packed).stdout.replace(str(packed).encode(), str(good).encode()) == whole


def test_a_pipe_by_name_is_read_once(tmp_path: Path, good: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with started("transactions", good, pipe) as process:
        pipe.write_bytes(good.read_bytes())
        assert process.stdout is not None
        assert process.stdout.read().count(b"\n") == 8
        assert process.wait(120) == 0


def test_results_of_a_stream_are_seen_while_it_goes_on(good: Path) -> None:
    with started("transactions", "-") as process:
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(good.read_bytes())
        process.stdin.flush()
        assert b"Setup communication" in process.stdout.readline()
        assert process.poll() is None
        process.stdin.close()
        assert process.stdout.read().count(b"\n") == 3
        assert process.wait(120) == 0


# ---- determinism ----------------------------------------------------------------------------------------------------


@pytest.fixture
def two(corpus: Path, tmp_path: Path) -> list[str]:
    """Two captures under names that do not depend on where they are."""
    names = []
    for name in ("s7ident_refused_upload.pcap", "tia_s300_goOnline.pcapng"):
        shutil.copy(corpus / name, tmp_path / name)
        names.append(name)
    return names


ENVIRONMENTS = (
    {"PYTHONHASHSEED": "0"},
    {"PYTHONHASHSEED": "1", "TZ": "Asia/Kathmandu", "LC_ALL": "C", "LANG": "C"},
    {
        "PYTHONHASHSEED": "random",
        "TZ": "America/St_Johns",
        "LC_ALL": "tr_TR.UTF-8",
        "LANG": "tr_TR.UTF-8",
        "PYTHONUTF8": "0",
    },
    {"PYTHONHASHSEED": "random", "PYTHONIOENCODING": "latin-1", "COLUMNS": "20", "FORCE_COLOR": "1"},
)


#: Runs every face in one process; each output ends with a NUL.
EVERY_FACE = """
import sys
from dissect.cli.main import main
for face in sys.argv[1].split("|"):
    try:
        main([*face.split(), *sys.argv[2:]])
    except SystemExit as end:
        assert not end.code, (face, end.code)
    sys.stdout.buffer.write(b"\\0")
    sys.stdout.flush()
"""


def test_the_same_input_gives_the_same_octets(two: list[str], tmp_path: Path) -> None:
    told = []
    for environment in ENVIRONMENTS:
        ran = subprocess.run(
            [sys.executable, "-c", EVERY_FACE, "|".join(map(" ".join, FACES)), *two],
            cwd=tmp_path,
            env={**os.environ, **environment},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            check=True,
        )
        assert ran.stderr == b""
        told.append(ran.stdout.split(b"\0"))
    for number, arguments in enumerate(FACES):
        outputs = {outputs[number] for outputs in told}
        assert len(outputs) == 1, arguments
        assert outputs != {b""}, arguments
    assert {len(outputs) for outputs in told} == {len(FACES) + 1}


def test_the_folder_does_not_matter(capfdbinary: Capture, monkeypatch: pytest.MonkeyPatch, good: Path) -> None:
    first = run(capfdbinary, "transactions", good)
    monkeypatch.chdir("/")
    assert run(capfdbinary, "transactions", good) == first


# ---- safety ---------------------------------------------------------------------------------------------------------

NAUGHTY = (
    "\x1b[31mred\x1b[0m",
    "\x1b]0;title\x07",
    "\x9b2J\x90q\x9c",
    "a\rb\nc\td\x0b\x0c\x08\x7f",
    "\u202edlrow\u202c \u2066x\u2069 \u200e\u200f\u061c",
    "\u2028line\u2029paragraph",
    "=HYPERLINK(1)",
    "+1+1",
    "-2+3",
    "@SUM(1)",
    "x;=1+1",
    "\"quoted\", 'and' , separated",
    "<script>alert(1)</script>",
    "long" * 500,
)
#: A TSAP or comment may hold what no encoding allows.
RAW = (b"\xff\xfe\x80", b"\xc3\x28", b"\xed\xa0\x80", b"\x00\x01")


@pytest.fixture(scope="module")
def hostile(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A capture that says every naughty thing wherever a device, or who wrote the file, may say something."""
    packets: list[Packet] = []
    comments: dict[int, str | bytes] = {}
    octets = [text.encode("utf-8") for text in NAUGHTY] + list(RAW)
    for number, said in enumerate(octets):
        talk = Talk(Flow(ports=(20000 + number, 102))).handshake()
        talk.send(0, messages.connect(0xE0, called=said[:200])).send(1, messages.connect(0xD0))
        talk.send(0, dt(messages.setup(messages.JOB, 0))).send(1, dt(messages.setup(messages.ACK_DATA, 0)))
        text = Item(0x03, len(said[:200]), 1, 0x84, 0)
        read(talk, 1, text, said[:200])
        talk.send(0, dt(messages.write_job(2, [text], [said[:200]]))).send(1, dt(messages.write_answer(2, [255])))
        symbol = bytes((0x12, 1 + len(said[:100]), 0xB2)) + said[:100]
        talk.send(0, dt(messages.pdu(messages.JOB, 3, b"\x04\x01" + symbol)))
        talk.send(0, dt(messages.pdu(messages.JOB, 4, b"\x28" + said[:200], said[:100])))
        talk.send(1, dt(said[:200]))
        comments[len(packets) + 1] = said
        talk.close(0)
        packets += [packet._replace(time_ns=packet.time_ns + number * 10**9) for packet in talk.packets()]
    return saved(tmp_path_factory.mktemp("hostile") / "hostile.pcapng", packets, comments)


def hostile_names(directory: Path, source: Path) -> Iterator[Path]:
    """Give copies of a capture under every naughty name that a file can have."""
    for said in [text.encode("utf-8") for text in NAUGHTY] + list(RAW):
        name = said[:200].replace(b"/", b"").replace(b"\x00", b"") + b".pcapng"
        path = os.path.join(os.fsencode(directory), name)  # noqa: PTH118 - pathlib has no names in octets
        with open(path, "wb") as file:  # noqa: PTH123 - as above
            file.write(source.read_bytes())
        yield Path(os.fsdecode(path))


def safe(arguments: tuple[str, ...], output: str) -> None:
    """Hold an output to what its format allows."""
    lines = output.split("\n")
    assert lines.pop() == ""
    for line in lines:
        assert not UNSAFE.search(line), repr(line)
    if "csv" in arguments:
        rows = list(csv.reader(io.StringIO(output)))
        assert len(rows) == len(lines)
        assert {len(row) for row in rows} == {len(rows[0])}
        for cell in [cell for row in rows for cell in row]:
            assert not cell.startswith(("=", "+", "@", "\t", "\r"))
            assert not cell.startswith("-") or cell[1:].replace(".", "").isdigit()
            assert not re.search("; *[=+@]", cell)
    elif "jsonl" in arguments:
        for line in lines:
            assert line.isascii()
            name = "transaction" if arguments[0] == "transactions" else "pdu"
            assert complaints(name, json.loads(line), exact=True) == []
    elif "json" in arguments:
        assert output.isascii()
        told = json.loads(output)
        assert complaints("analysis", told, exact=True) == []
        json.dumps(told, ensure_ascii=False).encode()


@pytest.mark.parametrize("arguments", FACES)
def test_nothing_a_device_says_steers_anything(capfdbinary: Capture, hostile: Path, arguments: tuple[str, ...]) -> None:
    ran = run(capfdbinary, *arguments, hostile)
    assert (ran.code, ran.err) == (0, "")
    safe(arguments, ran.out)


def test_values_and_comments_are_there_all_the_same(capfdbinary: Capture, hostile: Path) -> None:
    told = [json.loads(line) for line in run(capfdbinary, "transactions", "-T", "jsonl", hostile).out.splitlines()]
    values = [item["value"] for line in told if line["pdu_ref"] == 1 for item in line["items"]]
    assert values == [text.encode("utf-8")[:200].decode("latin-1") for text in NAUGHTY] + [
        said.decode("latin-1") for said in RAW
    ]
    shown = run(capfdbinary, "show", hostile).out
    assert "comment: \\x1b[31mred\\x1b[0m\n" in shown
    assert f"comment: {('long' * 500)[:1000]}… (2000 characters)\n" in shown


@pytest.mark.parametrize("arguments", FACES)
def test_no_file_name_steers_anything(
    capfdbinary: Capture, tmp_path: Path, good: Path, arguments: tuple[str, ...]
) -> None:
    names = list(hostile_names(tmp_path, good))
    ran = run(capfdbinary, *arguments, *names)
    assert (ran.code, ran.err) == (0, "")
    safe(arguments, ran.out)


@pytest.mark.parametrize("command", COMMANDS)
def test_no_complaint_about_a_file_steers_anything(
    capfdbinary: Capture, tmp_path: Path, good: Path, cut: Path, command: str
) -> None:
    for name in hostile_names(tmp_path, cut):
        damaged = run(capfdbinary, command, name)
        assert damaged.code == 3
        missing = run(capfdbinary, command, str(name) + "gone")
        also = run(capfdbinary, command, good, str(name) + "gone")
        assert (missing.code, also.code) == (2, 2)
        for said in (damaged.err, missing.err, also.err):
            assert said.count("\n") == 1
            assert not UNSAFE.search(said[:-1]), repr(said)


# ---- several files --------------------------------------------------------------------------------------------------


def test_a_finding_in_two_files_names_both(capfdbinary: Capture, tmp_path: Path) -> None:
    first, second = halves(tmp_path)
    ran = run(capfdbinary, "transactions", "-T", "jsonl", first, second)
    told = [json.loads(line) for line in ran.out.splitlines()]
    assert [(line["request_frame"], line["response_frame"]) for line in told] == [(6, 7), (8, 9), (10, 1), (2, None)]
    assert [(line["request_file"], line["response_file"]) for line in told] == [
        (str(first), str(first)),
        (str(first), str(first)),
        (str(first), str(second)),
        (str(second), None),
    ]
    assert f"  {first}:10→{second}:1 " in run(capfdbinary, "transactions", first, second).out


# ---- on a terminal --------------------------------------------------------------------------------------------------


def test_a_terminal_gets_colours_and_its_width(good: Path) -> None:
    ran = on_terminal("analyze", good, columns=70)
    assert ran.code == 0
    assert "\x1b[36m\x1b[1mConnections\x1b[0m\n" in ran.out
    assert "\x1b[33m" in ran.out
    bare = STYLES.sub("", ran.out)
    assert not UNSAFE.search(bare.replace("\n", ""))
    assert max(len(line) for line in bare.split("\n") if str(good) not in line) <= 70


def test_no_color_is_respected(good: Path) -> None:
    ran = on_terminal("analyze", good, columns=500, environment={"NO_COLOR": "1"})
    assert "\x1b" not in ran.out
    assert (
        ran.out
        == subprocess.run(
            [sys.executable, "-m", "dissect", "analyze", str(good)], capture_output=True, check=True
        ).stdout.decode()
    )


def test_a_pipe_gets_neither(s7dissect: Command, good: Path) -> None:
    assert b"\x1b" not in s7dissect("analyze", good).stdout


def test_progress_is_shown_on_a_terminal_for_large_files_only(tmp_path: Path) -> None:
    path = large(tmp_path / "large.pcapng", 24_000_000)
    ran = on_terminal("analyze", path, stdout=False)
    assert ran.code == 0
    assert "reading" in ran.err
    assert "reading" not in ran.out
    assert on_terminal("analyze", simple(tmp_path / "small.pcapng"), stdout=False).err == ""
    # Lines of results and a bar that redraws itself do not share a terminal, not even by way of a pipe into a pager.
    assert "reading" not in on_terminal("transactions", path).out
    assert "reading" not in on_terminal("transactions", path, stdout=False).err
    shown = on_terminal("analyze", path, columns=1000).out  # however long the name of the folder is
    bar, _, results = shown.rpartition("\x1b[2K")  # erases the line
    assert "reading" in bar
    assert "large.pcapng" not in bar
    assert "large.pcapng: " in results
    assert "reading" not in results
    packed = tmp_path / "large.pcapng.gz"
    packed.write_bytes(gzip.compress(path.read_bytes(), 0))
    assert "reading" in on_terminal("analyze", packed, stdout=False).err


def test_a_file_that_cannot_be_looked_at_does_not_end_the_others_on_a_terminal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whether a bar is worth it is found out before files are read; what cannot be read is said where it is."""

    def denied(path: Path, *_: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied", os.fspath(path))

    small = os.fspath(simple(tmp_path / "small.pcapng"))
    monkeypatch.setattr(Path, "open", denied)
    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    with Bar((small, "x" * 5000), streaming=False) as bar:
        bar.show(1)


def test_no_progress_goes_into_a_pipe(s7dissect: Command, tmp_path: Path) -> None:
    assert s7dissect("analyze", large(tmp_path / "large.pcapng", 24_000_000)).stderr == b""


def test_every_style_has_a_colour(monkeypatch: pytest.MonkeyPatch, capfdbinary: Capture) -> None:
    monkeypatch.setattr("sys.stdout.isatty", lambda: True, raising=False)
    monkeypatch.delenv("NO_COLOR", raising=False)
    write_lines([Line("a", style) for style in ("heading", "error", "failed", "warning", "note", "dim", "")])
    assert len(set(capfdbinary.readouterr().out.splitlines())) == 7


# ---- documentation --------------------------------------------------------------------------------------------------


#: Options that `dissect.cli.main` gives to all commands; they are described once.
SHARED = ("color", "local_time")
#: The section of docs/commands.md with the options of several commands.
COMMON = "Options of several commands"


def test_the_shared_options_are_in_the_document() -> None:
    text = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8").split("\n## Output\n")[1].split("\n## ")[0]
    for name in SHARED:
        assert f"`--{name.replace('_', '-')}" in text
        for command in COMMANDS:
            found = group.get_command(click.Context(group), command)
            assert found is not None
            assert name in [each.name for each in found.params]


@pytest.mark.parametrize(
    "command", [("transactions",), ("show",), ("analyze",), ("operations",), ("monitor", "--plain")]
)
def test_colours_are_as_asked_for(s7dissect: Command, good: Path, command: tuple[str, ...]) -> None:
    plain = s7dissect(*command, good).stdout
    assert b"\x1b" not in plain
    always = s7dissect(*command, "--color=always", good).stdout.decode()
    assert "\x1b[31m" in always or "\x1b[36m" in always or command[0] == "operations"
    assert STYLES.sub("", always) == plain.decode()
    ran = on_terminal(*command, good, columns=500)
    assert ran.code == 0
    assert STYLES.sub("", ran.out).split("s7dissect: ")[0] == plain.decode()
    assert ("\x1b[3" in ran.out) == (command[0] != "operations")
    for off in (
        on_terminal(*command, "--color=never", good),
        on_terminal(*command, good, environment={"NO_COLOR": "1"}),
    ):
        assert "\x1b" not in off.out


@pytest.mark.parametrize("columns", [60, 80, 120])
@pytest.mark.parametrize(
    "command", [("transactions",), ("show",), ("show", "-V"), ("operations",), ("monitor", "--plain")]
)
def test_lines_are_wrapped_to_the_terminal(good: Path, command: tuple[str, ...], columns: int) -> None:
    lines = on_terminal(*command, good, columns=columns, environment={"NO_COLOR": "1"}).out.splitlines()
    assert max(map(len, [line for line in lines if not line.startswith("s7dissect: ")])) <= columns


def test_local_time_in_lines_and_utc_for_programs(
    s7dissect: Command, good: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TZ", "Asia/Kolkata")
    for command in ("analyze", "transactions", "operations", "show", "monitor"):
        assert b"2024-03-04 05:06:07.0" in s7dissect.process(command, good).stdout
        local = s7dissect.process(command, "--local-time", good).stdout.decode()
        assert re.search(r"2024-03-04 10:36:07\.\d{6} \+05:30", local), command
        assert "UTC" not in local
    for form in ("jsonl", "csv"):
        told = s7dissect.process("transactions", "--local-time", "-T", form, good).stdout
        assert b"2024-03-04T05:06:07" in told
        assert b"10:36" not in told


@pytest.mark.parametrize("name", COMMANDS)
def test_every_option_is_in_the_document(name: str) -> None:
    text = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    every = [each for each in equipped(name).params if isinstance(each, click.Option) and not each.hidden]
    options = [each for each in every if each.name not in SHARED]
    written = [[*option.opts, *([option.metavar] if option.metavar else [])] for option in options]
    of_several = option_rows(text, COMMON)
    assert option_rows(text, name) == [words for words in written if words not in of_several]


def test_the_options_of_several_commands_are_in_the_document() -> None:
    text = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    there = [
        [*option.opts, *([option.metavar] if option.metavar else [])]
        for command in commands().values()
        for option in command.params
        if isinstance(option, click.Option)
    ]
    for words in option_rows(text, COMMON):
        assert there.count(words) > 1, words


def equipped(name: str) -> click.Command:
    """Return a command with the options that `dissect.cli.main` gives to all."""
    command = group.get_command(click.Context(group), name)
    assert command is not None
    return command


def option_rows(text: str, section: str) -> list[list[str]]:
    """Return the options of a section of docs/commands.md, each as its words."""
    part = text.split(f"\n## {section}\n")[1].split("\n## ", maxsplit=1)[0]
    return [
        row.replace("\\|", "|").split()
        for row in re.findall(r"^\| `(.*?)` \|", part.replace("`, `", " "), re.MULTILINE)
    ]


def test_the_lines_in_the_document_are_real(capfdbinary: Capture) -> None:
    text = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    told = re.findall(r"^    (\d{4}-.*)$", text, re.MULTILINE)
    real = "".join(
        run(capfdbinary, command, ROOT / "captures" / f"{name}.pcapng").out
        for command, name in (
            ("transactions", "item-errors"),
            ("transactions", "cut-with-reset"),
            ("operations", "transfer"),
        )
    ).splitlines()
    plant = ROOT / "captures" / "scd"
    scd = ("--scd", plant / "plant.toml", "--bind", plant / "plant.bind.toml", plant / "plant.pcapng")
    real += run(capfdbinary, "transactions", *scd).out.splitlines()
    assert len(told) == 7
    assert [line for line in told if line not in real] == []


def test_every_exit_code_is_in_the_document() -> None:
    text = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    codes = [int(code) for code in re.findall(r"^\| (\d+) \|", text, re.MULTILINE)]
    assert codes == [EXIT_OK, EXIT_GATE, EXIT_USAGE, EXIT_DAMAGED, EXIT_OUTPUT, EXIT_INTERRUPTED]
