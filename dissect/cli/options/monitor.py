"""The options of `s7dissect monitor` for additional tasks: evidence on disk, and alerts."""

from __future__ import annotations

import functools
import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from dissect.cli.options.given import was_given
from dissect.meaning.report.slugs import slugs_of
from dissect.wire.text import printable

if TYPE_CHECKING:
    from dissect.files.recording.ring_buffer import RingLimits
    from dissect.online.alerts.alert import Alert
    from dissect.online.alerts.engine import AlertEngine
    from dissect.online.alerts.loading import AlertRules
    from dissect.online.live.alerting import AlertCompanion
    from dissect.online.live.reports import ReportCompanion
    from dissect.online.live.run import Companion
    from dissect.online.live.session import Session
    from dissect.output.baseline.norms import Baseline

_TIME = re.compile(r"([0-9]{1,6})(ms|s|min)?")
_UNITS = {"ms": 1_000_000, "s": 1_000_000_000, "min": 60_000_000_000}
_PERIOD = re.compile(r"([0-9]{1,6})(s|min|h)")
_HOUR = 3600 * 1_000_000_000
_PERIODS = {"s": 1_000_000_000, "min": 60_000_000_000, "h": _HOUR}
_SIZE = re.compile(r"([0-9]{1,6})([KMGT])")
_SIZES = {"K": 10**3, "M": 10**6, "G": 10**9, "T": 10**12}
_LEAST = 10_000_000_000
_FILE = click.Path(dir_okay=False, readable=False)
#: Octets of the ring that are written together; collected data are written several times a second in any case.
_BATCH = 64 * 1024


def _limits(ctx: click.Context, param: click.Parameter, values: Sequence[str]) -> RingLimits | None:
    from dissect.files.recording.ring_buffer import parse_limits

    try:
        return parse_limits(values) if values else None
    except ValueError as error:
        raise click.BadParameter(f"{error}.", ctx, param) from None


def _kept(
    ctx: click.Context, param: click.Parameter, values: Sequence[tuple[str, str]]
) -> list[tuple[frozenset[str], int]]:
    """Return (slugs, nanoseconds before and after) of each ``--keep-around``."""
    kept = []
    for what, text in values:
        match = _TIME.fullmatch(text)
        if match is None:
            raise click.BadParameter(f"expected a time such as 500ms, 30s or 2min, got {text!r}.", ctx, param)
        try:
            kept.append((slugs_of(what), int(match[1]) * _UNITS[match[2] or "s"]))
        except ValueError as error:
            raise click.BadParameter(str(error), ctx, param) from None
    return kept


def _period(ctx: click.Context, param: click.Parameter, value: str | None) -> int:
    """Return the value of ``--every`` in nanoseconds, 0 if it was not given."""
    if value is None:
        return 0
    match = _PERIOD.fullmatch(value)
    length = int(match[1]) * _PERIODS[match[2]] if match is not None else 0
    if length < _LEAST:
        raise click.BadParameter(f"expected a time of at least 10 s such as 15min or 1h, got {value!r}.", ctx, param)
    return length


def _size(ctx: click.Context, param: click.Parameter, value: str | None) -> int:
    """Return the value of ``--keep-free`` in octets, 0 if it was not given."""
    if value is None:
        return 0
    match = _SIZE.fullmatch(value)
    if match is None or not int(match[1]):
        raise click.BadParameter(f"expected a size such as 500M or 2G, got {value!r}.", ctx, param)
    return int(match[1]) * _SIZES[match[2]]


def file_of(out: str) -> Path | None:
    """Return the file that ``-w`` names, None if it names a folder: as with tshark, a name with an extension is a file."""
    path = Path(out)
    return path if path.suffix and not path.is_dir() and not out.endswith("/") else None


class LiveExport(NamedTuple):
    """Tables that are written during a live capture: the folder, the duration of a file, and the name of the interface."""

    folder: Path
    every_ns: int
    source: str


def _export_folder(ctx: click.Context, param: click.Parameter, value: str | None) -> Path | None:
    from dissect.output.export.forms import UnknownFormError, target_of

    if value is None:
        return None
    try:
        target = target_of(value, [], 1)
    except UnknownFormError as error:
        raise click.BadParameter(printable(str(error)), ctx, param) from None
    if target.form.name != "parquet":
        raise click.BadParameter(
            f"only Parquet is written live, as parquet:FOLDER, not {target.form.name}.", ctx, param
        )
    if Path(target.path).exists() and not Path(target.path).is_dir():
        raise click.BadParameter(f"{printable(target.path)} is not a folder.", ctx, param)
    return Path(target.path)


def _file_time(ctx: click.Context, param: click.Parameter, value: str) -> int:
    match = _TIME.fullmatch(value)
    if match is None or not int(match[1]):
        raise click.BadParameter(f"expected a time such as 30s or 5min, got {value!r}.", ctx, param)
    return int(match[1]) * _UNITS[match[2] or "s"]


class Beside:
    """The parts that run beside the session, according to the options. `companions` makes it; `watch` passes it the session."""

    def __init__(
        self,
        directory: str | None,
        limits: RingLimits | None,
        kept: list[tuple[frozenset[str], int]],
        rules: str | None,
        baseline: str | None,
        export: LiveExport | None = None,
        reports: str | None = None,
        every_ns: int = 0,
        keep_free: int = 0,
        about: dict[str, object] | None = None,
        capture_filter: str = "",
    ) -> None:
        if about is not None and (directory is None or (file_of(directory) is not None and limits is None)):
            raise click.UsageError("--manifest needs -w with a folder, or -b.")
        if keep_free and directory is None:
            raise click.UsageError("--keep-free needs -w, the folder whose disk must not become full.")
        if every_ns and reports is None:
            raise click.UsageError("--every needs --report, the folder that pages are written to.")
        if directory is None and (limits is not None or kept):
            raise click.UsageError("-b and --keep-around need -w, where files are written to.")
        if directory == "-":
            raise click.UsageError("-w - would mix packets with the lines of events: name a file or a folder.")
        file = file_of(directory) if directory is not None else None
        if file is not None and kept:
            raise click.UsageError(
                f"--keep-around makes several files: name a folder for -w, not {printable(str(file))}."
            )
        if baseline is not None and rules is None:
            raise click.UsageError("--baseline needs --alerts.")
        self._limits = limits
        self._kept = kept
        self._rules = rules
        self._baseline = baseline
        self._export = export
        self._reports = reports
        self._every_ns = every_ns or _HOUR
        self._keep_free = keep_free
        self._about = about
        self._filter = capture_filter
        self._session: Session | None = None
        #: Takes changed rules and host names during the run; None without any.
        self.alerting: AlertCompanion | None = None
        self.reporting: ReportCompanion | None = None
        self._shown = False
        #: The only file that is written, or the name from which the names of the ring's files are made; None if -w names a
        #: folder.
        self._file = file
        #: The folder that must stay writable, None for none; and the folders that were created for it, the outermost first.
        self.directory = directory
        if file is not None:
            self.directory = str(file.parent) if limits is not None else None
        self.made: list[Path] = []

    @property
    def directories(self) -> list[str]:
        """The folders that must stay writable."""
        tables = str(self._export.folder) if self._export is not None else None
        return [one for one in (self.directory, tables, self._reports) if one is not None]

    def companions(self, name: str) -> list[Companion]:
        """Make the requested companions for ``name``, the watched source; errors are reported before the capture starts."""
        made: list[Companion] = []
        if self._file is not None and self._limits is None:
            made.append(self._one_file(self._file))
        elif self.directory is not None:
            made += self._evidence(self.directory)
        if self._rules is not None:
            self.alerting = self._alerts(self._rules)
            made.append(self.alerting)
        if self._export is not None:
            made.append(self._tables(self._export))
        if self._reports is not None:
            self.reporting = self._report(self._reports, name)
            made.append(self.reporting)
        return made

    def _tables(self, export: LiveExport) -> Companion:
        from dissect import __version__
        from dissect.online.live.export import ExportCompanion
        from dissect.output.export.extras import MissingLibraryError
        from dissect.packets.source.live.privileges import missing

        try:
            companion = ExportCompanion(export.folder, export.every_ns, export.source, __version__)
        except MissingLibraryError as error:
            raise click.ClickException(str(error)) from None
        self.made += missing(str(export.folder))
        export.folder.mkdir(parents=True, exist_ok=True)
        return companion

    def watch(self, session: Session, on_screens: bool) -> None:
        """Take the session; on screens, alerts are shown there and not on stderr."""
        self._session = session
        self._shown = on_screens

    def _one_file(self, path: Path) -> Companion:
        import platform

        from dissect import __version__
        from dissect.online.proxy.capture_file import CaptureFile
        from dissect.packets.source.pcapng_writer import PcapngWriter
        from dissect.wire.config.saving import is_special

        new = not is_special(path)
        writer = PcapngWriter(
            str(path), os_name=platform.platform(), application=f"s7dissect {__version__} monitor", batch=_BATCH
        )
        if new:
            self.made.append(path)
        writer.capture_filter = self._filter
        return CaptureFile(writer)

    def _evidence(self, directory: str) -> list[Companion]:
        import platform

        from dissect import __version__
        from dissect.files.recording.event_capture import EventCapture
        from dissect.files.recording.ring_buffer import RingBuffer
        from dissect.online.live.evidence import KeeperCompanion, RingCompanion
        from dissect.packets.source.live.privileges import missing

        self.made += missing(directory)
        name = self._file.stem if self._file is not None else "s7dissect"
        program, system = f"s7dissect {__version__}", platform.platform()
        made: list[Companion] = []
        if self._limits is not None or not self._kept:
            ring = RingBuffer(
                directory,
                self._limits,
                name,
                program,
                os_name=system,
                batch=_BATCH,
                keep_free=self._keep_free,
            )
            ring.capture_filter = self._filter
            made.append(RingCompanion(ring, about=self._manifest_facts()))
        for slugs, span_ns in self._kept:
            keeper = EventCapture(
                directory,
                span_ns,
                span_ns,
                slugs=slugs,
                application=program,
                os_name=system,
                keep_free=self._keep_free,
            )
            keeper.capture_filter = self._filter
            made.append(KeeperCompanion(keeper))
        return made

    def _manifest_facts(self) -> dict[str, object] | None:
        """Return the facts of the run for the manifest, None without one."""
        if self._about is None:
            return None
        import platform

        from dissect import __version__
        from dissect.files.recording.manifest import masked
        from dissect.online.metrics.clock import clock_offset

        offset = clock_offset()
        return {
            "program": f"s7dissect {__version__}",
            "host": platform.node(),
            "command": masked(sys.argv),
            **self._about,
            "clock": "unsynchronized" if offset is None else "synchronized",
            "clock_offset_s": offset,
        }

    def _alerts(self, path: str) -> AlertCompanion:
        from dissect.online.alerts.dispatcher import Dispatcher
        from dissect.online.live.alerting import AlertCompanion

        rules, baseline = self._rules_read(path)
        dispatcher = Dispatcher(rules.actions, write=self._alert, tell=self._say)
        self.made += dispatcher.prepare()
        return AlertCompanion(_engine_of(rules, baseline, dispatcher.submit), dispatcher)

    def _rules_read(self, path: str) -> tuple[AlertRules, Baseline | None]:
        """Return rules and baseline as they are in their files now."""
        from dissect.online.alerts.loading import load_rules
        from dissect.output.baseline.loading import load_baseline
        from dissect.scd.user_file import FileError

        try:
            return load_rules(path), load_baseline(self._baseline) if self._baseline is not None else None
        except FileError as error:
            raise click.ClickException(str(error)) from None

    def rules_again(self) -> Callable[[], None] | None:
        """Read rules and baseline again; return a function that applies them between two packets, None without rules.

        Raises `click.ClickException` for files that cannot be used.
        """
        from dissect.online.alerts.dispatcher import Dispatcher
        from dissect.online.live.alerting import Succession

        companion = self.alerting
        if companion is None or self._rules is None:
            return None
        rules, baseline = self._rules_read(self._rules)
        dispatcher = Dispatcher(rules.actions, write=self._alert, tell=self._say)
        dispatcher.prepare()
        succession = Succession(companion.dispatcher, dispatcher, self._say)
        engine = _engine_of(rules, baseline, succession.submit)
        return functools.partial(companion.replace, engine, dispatcher, succession)

    def _report(self, directory: str, name: str) -> ReportCompanion:
        from dissect import __version__
        from dissect.cli.configuration import hosts
        from dissect.cli.display import clock
        from dissect.cli.report import needs_template_engine
        from dissect.online.live.reports import ReportCompanion
        from dissect.packets.source.live.privileges import missing

        needs_template_engine()
        if Path(directory).exists() and not Path(directory).is_dir():
            raise click.UsageError(f"--report writes several pages: {printable(directory)} is not a folder.")
        self.made += missing(directory)
        Path(directory).mkdir(parents=True, exist_ok=True)
        return ReportCompanion(directory, self._every_ns, name, __version__, clock(), hosts())

    def _alert(self, line: str) -> None:
        """Show the line of an alert where it is visible; without its time on the screens, which show the clock at the top."""
        if self._shown and self._session is not None:
            from dissect.online.live.events import ALERT

            self._session.say(line.partition("  ")[2], ALERT)
        else:
            self._say(line)

    def _say(self, line: str) -> None:
        """Show a message about alerts where it will be seen."""
        if self._shown and self._session is not None:
            self._session.say(line)
            return
        from dissect.online.alerts.actions import to_stderr

        to_stderr(line)


def _engine_of(rules: AlertRules, baseline: Baseline | None, tell: Callable[[Alert], None]) -> AlertEngine:
    from dissect.online.alerts.engine import AlertEngine
    from dissect.online.alerts.loading import RuleError

    try:
        return AlertEngine(rules, baseline, tell)
    except RuleError as error:
        raise click.UsageError(f"{error} with --baseline.") from None


def beside_options(command: Callable[..., int]) -> Callable[..., int]:
    """Add the options to a command; their `Beside` is passed to it as ``beside``."""

    @click.option(
        "-w",
        "--write",
        "directory",
        metavar="OUT",
        help="Write every packet to this pcapng file, or where OUT has no extension or is a folder, to files in it …",
    )
    @click.option(
        "-b",
        "--ring",
        "limits",
        multiple=True,
        callback=_limits,
        metavar="LIMIT",
        help="… in a ring: a new file after filesize:KB or duration:SECONDS; only the latest files:NUMBER, total:KB or "
        "days:NUMBER are kept.",
    )
    @click.option(
        "--keep-free",
        "keep_free",
        callback=_size,
        metavar="SIZE",
        help="With -w: leave so much of the disk free, such as 500M or 2G; a ring removes its oldest files first.",
    )
    @click.option(
        "--keep-around",
        "kept",
        nargs=2,
        multiple=True,
        callback=_kept,
        metavar="FINDING TIME",
        help="Write the packets from TIME before to TIME after each FINDING (a severity, slug, or 'security.*') to a file of "
        "their own in the folder of -w; without -b only these are written.",
    )
    @click.option(
        "--manifest",
        is_flag=True,
        help="With -w or -b: keep a manifest of the files, chained by hashes, for `s7dissect evidence verify`.",
    )
    @click.option("--alerts", "rules", type=_FILE, metavar="RULES", help="Load alert rules from this file.")
    @click.option(
        "--baseline",
        "baseline",
        type=_FILE,
        metavar="PLANT",
        help="With --alerts: the baseline that rules compare with.",
    )
    @click.option(
        "--export",
        "export",
        callback=_export_folder,
        metavar="FORM:FOLDER",
        help="Also write tables while watching, as parquet:FOLDER (see `s7dissect help export`).",
    )
    @click.option(
        "--export-every",
        "export_ns",
        callback=_file_time,
        default="5min",
        show_default=True,
        metavar="TIME",
        help="With --export: begin new files after this time. The rows of a file can be read once it is complete.",
    )
    @click.option(
        "--report",
        "reports",
        metavar="DIR",
        help="Write an HTML page for each period, and one at the end, to this folder (see `s7dissect help report`).",
    )
    @click.option(
        "--every",
        "every_ns",
        callback=_period,
        metavar="TIME",
        help="With --report: the length of a period, such as 15min or 1h (default 1h).",
    )
    @functools.wraps(command)
    def with_beside(
        *arguments: Any,
        directory: str | None,
        limits: RingLimits | None,
        kept: list[tuple[frozenset[str], int]],
        rules: str | None,
        baseline: str | None,
        export: Path | None,
        export_ns: int,
        reports: str | None,
        every_ns: int,
        keep_free: int,
        manifest: bool,
        **options: Any,
    ) -> int:
        if export is None and was_given("export_ns"):
            raise click.UsageError("--export-every needs --export, the folder that tables are written to.")
        source = options.get("interface") or options.get("file") or "live"
        if not isinstance(source, str):  # several interfaces
            source = ", ".join(source)
        tables = LiveExport(export, export_ns, source) if export is not None else None
        capture_filter = options.get("expression") or ""
        about = {"source": source, "filter": capture_filter} if manifest else None
        beside = Beside(
            directory, limits, kept, rules, baseline, tables, reports, every_ns, keep_free, about, capture_filter
        )
        return command(*arguments, beside=beside, **options)

    return with_beside
