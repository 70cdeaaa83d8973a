"""`s7dissect extcap`: S7 traffic for Wireshark, live or from a file, with the results as comments of its packets.

Wireshark starts the programs in its extcap folder: at its own start to query their interfaces, and to capture. ``--install``
puts a wrapper of this command there.
"""

from __future__ import annotations

import os
import select
import shlex
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from dissect import __version__
from dissect.cli import extcap_sentences as sentences
from dissect.cli.main import EXIT_DAMAGED, EXIT_INTERRUPTED, EXIT_OK
from dissect.cli.options.scd import scd_options
from dissect.cli.options.select import where_option
from dissect.cli.options.tags import tag_options
from dissect.cli.options.tls import tls_option
from dissect.cli.run import complain, slow_option, write
from dissect.packets.source.live import BUFFER_MIB
from dissect.packets.source.wireshark import find_program
from dissect.wire.config.saving import save
from dissect.wire.text import printable

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from dissect.engine.pipeline import Options
    from dissect.online.live.commented import CommentedStream
    from dissect.online.live.run import LiveRun
    from dissect.packets.source.pcapng_writer import PcapngWriter

_EXIT_CODES: Final = (
    "Exit code: 0 success, also when Wireshark stops the capture, 2 wrong use, or a source that cannot be opened, 3 a damaged "
    "or truncated file or a source that failed, 5 the output could not be written."
)
#: Octets of packets from a file that are gathered before they are written; live ones are written one by one.
_BATCH: Final = 65_536
#: Message about a folder that the user named.
_ELSEWHERE: Final = "if that is an extcap folder of Wireshark (Help, About, Folders), it lists after a restart"
#: Seconds that a program may take to report its folders.
_PATIENCE_S: Final = 30


def _asked(name: str, what: str, **more: Any) -> Callable[[Any], Any]:
    """Return an option that only Wireshark gives."""
    return click.option(name, help=f"{what} (Wireshark)", **more)


@click.command("extcap", epilog=_EXIT_CODES)
@click.option(
    "--install",
    "folder",
    is_flag=False,
    flag_value="",
    default=None,
    metavar="[DIR]",
    help="Write the wrapper that Wireshark starts into DIR, by default its personal extcap folder, which tshark knows.",
)
@click.option("--force", is_flag=True, help="With --install: replace a wrapper that differs.")
@_asked("--extcap-interfaces", "List what can be captured from", is_flag=True)
@_asked("--extcap-version", "Version of Wireshark", metavar="VERSION", expose_value=False)
@_asked("--extcap-interface", "Which of them", metavar="ID", type=click.Choice(tuple(sentences.INTERFACES)))
@_asked("--extcap-dlts", "List its link types", is_flag=True)
@_asked("--extcap-config", "List its options", is_flag=True)
@_asked("--extcap-reload-option", "List the choices of one option again", metavar="NAME")
@_asked("--extcap-capture-filter", "Capture filter; checked only, without --capture", metavar="FILTER")
@_asked("--extcap-control-in", "Not used", metavar="PATH", expose_value=False)
@_asked("--extcap-control-out", "Not used", metavar="PATH", expose_value=False)
@_asked("--capture", "Capture", is_flag=True)
@_asked("--fifo", "File to which packets are written", metavar="PATH")
@click.option(
    "--interface", "interface", metavar="NAME", help="Live: the network interface (see `s7dissect interfaces`)."
)
@click.option("--file", "file", metavar="FILE", help="From a file: pcap or pcapng, plain or compressed.")
@where_option(
    "packet",
    "transaction",
    "finding",
    help="From a file: only packets that this expression selects, as with `s7dissect cut`.",
)
@slow_option
@scd_options
@tag_options
@tls_option
def command(
    folder: str | None,
    force: bool,
    extcap_interfaces: bool,
    extcap_interface: str | None,
    extcap_dlts: bool,
    extcap_config: bool,
    extcap_reload_option: str | None,
    extcap_capture_filter: str | None,
    capture: bool,
    fifo: str | None,
    interface: str | None,
    file: str | None,
    where: str | None,
    slow_ns: int,
    **reading: Any,
) -> int:
    """Let Wireshark capture S7 with findings as packet comments: live, or from a file.

    Install it once with --install. Wireshark and tshark then list two more interfaces: s7dissect captures from a network
    interface, s7dissect-file reads a capture. The display filter `frame.comment contains "s7dissect:"` shows the packets with
    findings. Wireshark itself gives all other options.
    """
    if folder is not None:
        return _install(folder, force)
    if extcap_interfaces:
        write(sentences.interface_sentences(__version__))
        return EXIT_OK
    if extcap_interface is None:
        raise click.UsageError("Wireshark runs this command. To make it known there: s7dissect extcap --install")
    if extcap_dlts:
        write(sentences.link_sentences())
    elif extcap_config:
        _write_options(extcap_interface, extcap_reload_option)
    elif capture:
        if fifo is None:
            raise click.UsageError("--capture needs --fifo, where packets are written to.")
        options = _options(slow_ns, **reading)
        with _writing(fifo, live=extcap_interface == sentences.LIVE) as writer:
            if extcap_interface == sentences.LIVE:
                return _live(interface, extcap_capture_filter or "", writer, options)
            return _from_file(file, where, extcap_capture_filter or "", writer, options)
    elif extcap_capture_filter is not None:
        write(_complaints(extcap_interface, extcap_capture_filter))
    else:
        raise click.UsageError("--extcap-interface needs --extcap-dlts, --extcap-config or --capture.")
    return EXIT_OK


# ---- what Wireshark asks --------------------------------------------------------------------------------------------


def _write_options(interface: str, reload_option: str | None) -> None:
    from dissect.packets.source.live.interfaces import list_interfaces

    interfaces = list_interfaces(find_program("dumpcap")) if interface == sentences.LIVE else []
    lines = list(sentences.option_sentences(interface, interfaces))
    write([line for line in lines if line.startswith("value")] if reload_option else lines)


def _complaints(interface: str, expression: str) -> list[str]:
    """Return the errors in a capture filter, in one line; none if it can be used."""
    from dissect.packets.source.live.filter import complaint_about

    if interface == sentences.FILE:
        return [_NO_FILTER] if expression.strip() else []
    complaint = complaint_about(expression) if expression.strip() else ""
    return [printable(complaint)] if complaint else []


_NO_FILTER: Final = "a capture filter does not apply to a file; use the option Only (--where)"


# ---- capturing ------------------------------------------------------------------------------------------------------


def _options(slow_ns: int, **reading: Any) -> Options:
    from dissect.engine.pipeline import Options

    return Options(slow_ns, **reading)


@contextmanager
def _writing(fifo: str, live: bool) -> Iterator[PcapngWriter]:
    """Open the pipe that Wireshark waits for, before anything that may fail or that drops privileges.

    Wireshark ends a capture by closing the pipe, so that is not an error. An existing file is replaced, as other extcap
    programs do.
    """
    from dissect.packets.source.pcapng_writer import PcapngWriter

    writer = PcapngWriter(
        fifo, application=f"s7dissect {__version__} extcap", batch=0 if live else _BATCH, overwrite=True
    )
    try:
        yield writer
    except BrokenPipeError:
        return
    finally:
        writer.abandon()


def _from_file(file: str | None, where: str | None, expression: str, writer: PcapngWriter, options: Options) -> int:
    """Write a capture with comments to the pipe."""
    from dissect.cli.second_pass import check_files, read_again, read_first
    from dissect.files.recording.cutter import Cutter
    from dissect.meaning.select.selection import Selection, Wanted

    if file is None:
        raise click.ClickException("choose a capture file in the options of this interface (--file).")
    if expression.strip():
        raise click.ClickException(f"{_NO_FILTER}.")
    check_files([file], writer.path, force=True)
    selection = Selection(Wanted())
    run, code, packets = read_first([file], selection, where, options)
    if code == EXIT_INTERRUPTED:  # so Wireshark stops it
        return EXIT_OK
    complain(run, code)
    choice = selection.choice(-(2**63), 2**63)
    if packets is not None:
        choice.narrow(packets.test())
    read_again([file], Cutter(choice, writer))
    writer.close()
    return code


def _live(interface: str | None, expression: str, writer: PcapngWriter, options: Options) -> int:
    """Write the traffic of an interface to the pipe, with comments, until Wireshark closes it."""
    from dissect.cli.rights import open_interface
    from dissect.cli.watching import LiveInterruption
    from dissect.engine.observer import Observer
    from dissect.online.live.commented import CommentedStream
    from dissect.online.live.run import LiveRun

    if interface is None:
        raise click.ClickException("choose a network interface in the options of this interface (--interface).")
    source = open_interface(interface, expression, "auto", "", None, False, BUFFER_MIB)
    stream = CommentedStream(writer)
    run = LiveRun(source, Observer(), options, companions=[stream], name=interface)
    with LiveInterruption(run.stop):
        try:
            while stream.error is None and not _is_closed(writer) and run.step():
                continue
        finally:
            run.finish()
    _tell(run, stream)
    if stream.error is not None:
        raise stream.error
    return EXIT_DAMAGED if run.file.loss else EXIT_OK


def _is_closed(writer: PcapngWriter) -> bool:
    """Return whether the reader of the pipe is gone; without traffic no write would show it."""
    if sys.platform == "win32" or writer.closed:
        return writer.closed
    poll = select.poll()
    poll.register(writer.fileno(), 0)
    return any(event & select.POLLERR for _, event in poll.poll(0))


def _tell(run: LiveRun, stream: CommentedStream) -> None:
    """Report on stderr, which Wireshark shows, the findings that came too late for any packet."""
    complaints = [*stream.late, *[f"s7dissect: {failure}" for failure in run.failures]]
    if stream.dropped:
        complaints.append(f"s7dissect: {stream.dropped} more findings came after the last packet")
    if run.file.loss:
        complaints.append(f"s7dissect: {run.file.name}: {run.file.loss}")
    for line in complaints:
        click.echo(printable(line), err=True)


# ---- installing -----------------------------------------------------------------------------------------------------


def _install(folder: str, force: bool) -> int:
    """Write the wrapper and report it."""
    place = Path(folder) if folder else _extcap_folder()
    own = not folder or _is_extcap_folder(place)
    windows = sys.platform == "win32"
    path = place / ("s7dissect.bat" if windows else "s7dissect")
    content = _wrapper(windows).encode()
    if path.exists() and path.read_bytes() != content and not force:
        raise click.UsageError(f"{printable(str(path))} exists and differs; --force replaces it.")
    place.mkdir(parents=True, exist_ok=True)
    save(path, content, 0o777)
    if not windows:
        path.chmod(path.stat().st_mode | 0o111)
    write(
        [
            f"wrote {printable(str(path))}",
            f"{'Wireshark lists it after a restart' if own else _ELSEWHERE}: "
            + ", ".join([f"{name} ({display})" for name, display in sentences.INTERFACES.items()]),
            "to remove it, delete that file",
        ]
    )
    return EXIT_OK


def _wrapper(windows: bool) -> str:
    """Return the script that starts this command with the interpreter that runs it now, wherever it is started."""
    if windows:
        return f'@echo off\r\n"{sys.executable}" -P -m dissect extcap %*\r\n'
    return (
        "#!/bin/sh\n# Written by `s7dissect extcap --install`; Wireshark starts it.\n"
        f'exec {shlex.quote(sys.executable)} -P -m dissect extcap "$@"\n'
    )


def _is_extcap_folder(place: Path) -> bool:
    """Return whether a folder is one where Wireshark looks."""
    try:
        return place.resolve() == _extcap_folder().resolve()
    except (click.UsageError, OSError):
        return False


def _extcap_folder() -> Path:
    """Return Wireshark's personal extcap folder, which differs by version and system, so tshark is asked."""
    program = find_program("tshark") or find_program("wireshark")
    if not program:
        raise click.UsageError(
            "the folder is unknown without tshark: use --install DIR (Wireshark: Help, About, Folders, "
            "Personal Extcap path)."
        )
    try:
        asked = subprocess.run(
            [program, "-G", "folders"], stdin=subprocess.DEVNULL, capture_output=True, check=False, timeout=_PATIENCE_S
        ).stdout
    except (OSError, subprocess.TimeoutExpired):
        asked = b""
    folders = {}
    for line in asked.decode("utf-8", "surrogateescape").splitlines():
        name, tab, value = line.partition("\t")
        if tab:
            folders[name.strip().rstrip(":").lower()] = value.strip()
    if "personal extcap path" in folders:
        return Path(folders["personal extcap path"])
    if "personal configuration" in folders:  # versions that do not list it use this one
        return Path(folders["personal configuration"], "extcap")
    raise click.UsageError(
        f"{printable(os.fsdecode(program))} -G folders names no extcap folder: give it as --install DIR."
    )
