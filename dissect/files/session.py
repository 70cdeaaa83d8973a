"""Captures joined to the pipeline: `open` iterates events, `analyze` sums them up, `devices` lists the stations.

Files given together are read one after another. A file whose first packet comes no more than `CONTINUES_NS` after the last one
of the file before it, as in a ring buffer, continues the connections of that file; any other file starts a new capture.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, TypeAlias, cast

from mypy_extensions import i64

from dissect.engine.acts.act import Act
from dissect.engine.exchange import PayloadDecoder
from dissect.engine.findings.reporter import Finding
from dissect.engine.observer import Observer
from dissect.engine.pipeline import Options, Pipeline
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.naming import Naming
from dissect.engine.transactions.operation import Operation
from dissect.engine.transactions.payloads import ScdMessage
from dissect.engine.transactions.side import Side
from dissect.engine.transactions.transaction import AS_DICT, Transaction
from dissect.meaning.report.analysis import Analysis, Part
from dissect.packets.source.given import Source, given_one, open_source
from dissect.packets.source.packet import CONTINUES_NS, CaptureError, PacketSink, Reader, SourceFile
from dissect.packets.source.remote import shown
from dissect.protocols.s7.message import Pdu, parse_pdu
from dissect.protocols.s7plus.message import PlusPdu, parse_plus
from dissect.wire.copies import refuse
from dissect.wire.errors import Error, of_family
from dissect.wire.text import printable

if TYPE_CHECKING:
    from dissect.meaning.inventory.collector import Inventory
    from dissect.meaning.inventory.model import Device
    from dissect.meaning.select import Where
    from dissect.meaning.select.sieve import Sieve
    from dissect.meaning.select.things import Context
    from dissect.meaning.tags import TagSet
    from dissect.protocols.tls.key_log import KeyLog
    from dissect.scd.dictionary import Dictionary

#: Files of tags: one, several, or the result of `dissect.meaning.tags.load_tags`.
Tags: TypeAlias = "str | os.PathLike[str] | Sequence[str | os.PathLike[str]] | TagSet | None"

#: Files with session keys of TLS: one or several.
KeyLogFiles: TypeAlias = "str | os.PathLike[str] | Sequence[str | os.PathLike[str]] | None"

#: The events that `open` yields.
Event = Connection | Pdu | PlusPdu | ScdMessage | Transaction | Operation | Act | Finding


def _line(transaction: Transaction) -> dict[str, object]:
    """Return the content of the JSON line of a transaction."""
    from dissect.meaning.report.contract import transaction_as_dict

    return transaction_as_dict(transaction)


AS_DICT.append(_line)


class _Joint(PacketSink):
    """Passes a file's packets to the pipeline, and the time of the first one to `Run.join`."""

    def __init__(self, run: Run) -> None:
        self._run = run

    def frame(self, time_ns: i64, buf: bytes, start: i64, end: i64, wire_length: i64, link_type: i64) -> None:
        self._run.join(time_ns)
        self._run.pipeline.frame(time_ns, buf, start, end, wire_length, link_type)

    def comment(self, text: str) -> None:
        self._run.pipeline.comment(text)

    def secrets(self, text: bytes) -> None:
        self._run.pipeline.secrets(text)


class Run:
    """A capture, or several read one after another, into a pipeline that feeds ``observer``.

    A capture is a path, an open binary file, or packets (`dissect.packets.source.given.Source`); several are given in a list.
    Raises `CaptureError` from `step` if one cannot be read at all, unless ``lenient``: then it is a file without packets, and
    the reason is its damage. A file that was given open stays open.
    """

    def __init__(
        self,
        sources: Sequence[Source] | Source,
        observer: Observer,
        options: Options | None = None,
    ) -> None:
        # A str is a sequence of str, too: without this check each of its characters would be taken for a path.
        self._sources = cast(
            "list[Source]", [sources] if given_one(sources) else list(cast("Sequence[Source]", sources))
        )
        self._observer = observer
        self._options = options
        self._reader: Reader | None = None
        self._joined = False
        self._finished = False
        self.lenient = False
        self.pipeline = Pipeline(observer, options)
        self.files: list[SourceFile] = []

    def __reduce__(self) -> str:
        raise refuse("a Run", "it reads a file; copy what its observer holds")

    def step(self) -> bool:
        """Read some more (about 256 KiB); False when everything was read and every connection is closed."""
        reader = self._reader
        if reader is None:
            if not self._sources:
                self.finish()
                return False
            source = self._sources.pop(0)
            try:
                reader, name = open_source(source)
            except CaptureError as error:
                if not self.lenient or not isinstance(source, (str, os.PathLike)):
                    raise
                self._leave_out(os.fspath(source), str(error))
                return True
            self._reader = reader
            self._joined = not self.files
            self.files.append(SourceFile(name, self.pipeline.frames + 1))
        more = reader.step(self.pipeline if self._joined and reader.packets else _Joint(self))
        file = self.files[-1]
        file.packets = reader.packets
        file.octets = reader.octets
        if not more:
            self._close(reader, file)
        self._pass_on()
        return True

    def _leave_out(self, path: str, why: str) -> None:
        file = SourceFile(shown(path), self.pipeline.frames + 1)
        file.damage = why.removeprefix(f"{printable(file.name)}: ")
        self.files.append(file)
        self.pipeline.note_damage(f"{file.name}: {file.damage}")

    def read(self) -> None:
        """Read to the end. No file stays open, even if an exception ends the reading."""
        try:
            while self.step():
                pass
        finally:
            self.close()

    def join(self, time_ns: int) -> None:
        """Take the time of a file's first packet; start a new capture unless it is within `CONTINUES_NS` of the file before."""
        if self._joined:
            return
        self._joined = True
        self.files[-1].first_ns = time_ns
        gap = time_ns - self.pipeline.now_ns
        if not 0 <= gap <= CONTINUES_NS:
            self.pipeline.finish()
            self.pipeline.restart_clock(time_ns)

    def finish(self) -> None:
        """Close every connection; may be called early, and twice."""
        if self._reader is not None:
            self._close(self._reader, self.files[-1])
        if not self._finished:
            self._finished = True
            self.pipeline.finish()
            self.pipeline.forget()
            self._pass_on()

    def _pass_on(self) -> None:
        """Raise an exception that the program's own observer raised: only a bug of the analyzer becomes a finding."""
        bug = self.pipeline.exchange.bug
        if bug is None:
            return
        self.pipeline.exchange.bug = None
        import traceback  # imported late: it loads more modules, and few runs have a bug

        own = {kind.__module__ for kind in type(self._observer).__mro__ if not kind.__module__.startswith("dissect.")}
        if any(
            [frame.f_globals.get("__name__") in own - {"builtins"} for frame, _ in traceback.walk_tb(bug.__traceback__)]
        ):
            raise bug

    def close(self) -> None:
        """Close the file that is being read, if its rest is not wanted."""
        if self._reader is not None:
            self._reader.close()
            self._reader = None

    def _close(self, reader: Reader, file: SourceFile) -> None:
        self._reader = None
        file.packets = reader.packets
        file.octets = reader.octets
        if file.packets:
            file.last_ns = self.pipeline.now_ns
            if file is self.files[0]:  # `join`, which sets the time of any other, is not called for the first
                file.first_ns = self.pipeline.first_ns
        file.damage = reader.damage
        file.rejected = reader.rejected
        file.notes = list(reader.notes)
        if file.loss:
            self.pipeline.note_damage(f"{file.name}: {file.loss}")
        lost = reader.stated_loss()
        if lost:
            self.pipeline.note_dropped(f"{file.name}: {lost}, as the file states")
        reader.close()


class EventQueue(Observer):
    """Collects events until the iterator hands them out."""

    def __init__(self, pdus: bool) -> None:
        super().__init__()
        self.wants_pdus = pdus
        self.events: list[Event] = []

    def pdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes, cut: bool) -> None:
        """Keep an S7comm PDU."""
        self.events.append(parse_pdu(octets, frame, time_ns, side.connection.number, side.index, cut))

    def plus_pdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes, cut: bool) -> None:
        """Keep an S7comm-plus PDU."""
        self.events.append(parse_plus(octets, frame, time_ns, side.connection.number, side.index, cut))

    def scd(self, frame: i64, time_ns: i64, side: Side, found: ScdMessage) -> None:
        """Keep an SCD message."""
        self.events.append(found)

    def transaction(self, transaction: Transaction) -> None:
        """Keep a transaction."""
        self.events.append(transaction)

    def operation(self, operation: Operation) -> None:
        """Keep an operation."""
        self.events.append(operation)

    def act(self, act: Act) -> None:
        """Keep an act."""
        self.events.append(act)

    def finding(self, finding: Finding) -> None:
        """Keep a finding."""
        self.events.append(finding)

    def connection_closed(self, connection: Connection) -> None:
        """Keep a connection, which is over."""
        self.events.append(connection)


def naming_of(tags: Tags) -> Naming | None:
    """Return a `Naming` that names values by the tags of files, None for no tags. Raises `dissect.meaning.tags.TagError`."""
    if tags is None:
        return None
    from dissect.meaning.tags import TagSet, load_tags

    if isinstance(tags, TagSet):
        return tags.naming()
    with of_family():
        return load_tags([tags] if isinstance(tags, (str, os.PathLike)) else tags).naming()


def decoder_of(
    scd: str | os.PathLike[str] | Dictionary | None, bind: str | os.PathLike[str] | None
) -> PayloadDecoder | None:
    """Return a decoder for SCD, None if neither a dictionary nor bindings are given.

    Raises ValueError if only one of the two is given, and `scd.DictionaryError` or `dissect.meaning.bindings.BindingError` for
    a wrong file.
    """
    if scd is None and bind is None:
        return None
    if scd is None or bind is None:
        raise ValueError("decoding SCD needs both a dictionary (scd) and a file of bindings (bind)")
    from dissect.meaning.bindings import load_carrier

    with of_family():
        return load_carrier(scd, bind)


def where_of(where: str | Where | None, options: Options) -> Where | None:
    """Return an expression of option -Y, parsed if it is a str; None for None. Raises `SelectError` for a wrong one.

    If the expression can rule out whole connections, set ``options.only``, so that these are not read at all.
    """
    if where is None:
        return None
    from dissect.meaning.select import Where

    chosen = Where(where) if isinstance(where, str) else where
    if chosen.narrows:
        options.only = chosen.may_hold
    return chosen


class Reading:
    """The task of reading captures: files, options of the engine, and the selection ``where``.

    The command line and the functions of the library make their runs from it. ``sieve`` filters what the observer of the latest
    run receives; None if it receives everything. ``context`` is for an observer that shows fields although nothing is selected.
    """

    def __init__(
        self,
        paths: Sequence[Source],
        options: Options,
        where: str | Where | None = None,
        context: Context | None = None,
    ) -> None:
        self.paths = paths
        self.options = options
        self.where = where_of(where, options)
        self.sieve: Sieve | None = None
        self._context = self.where.context if self.where is not None else context

    def sieved(self, observer: Observer) -> Observer:
        """Return an observer that passes only selected things to ``observer``; ``observer`` itself if all is selected."""
        if self.where is None:
            return observer
        from dissect.meaning.select.sieve import Sieve

        self.sieve = Sieve(observer, self.where)
        return self.sieve

    def begin(self, pipeline: Pipeline, files: Sequence[SourceFile], several: bool) -> None:
        """Prepare the fields for a new run; packets of ``several`` files are numbered in each."""
        if self._context is not None:
            from dissect.meaning.report.words import Places

            self._context.begin(pipeline, Places(files, several).number if several else None)

    def run(
        self,
        observer: Observer,
        sieved: bool = True,
        several: bool = False,
        make: Callable[[Sequence[Source], Observer, Options], Run] = Run,
    ) -> Run:
        """Return a run that reports selected things to ``observer``, or everything if not ``sieved``.

        ``several``: packets are named with their file, even if there is only one. ``make`` makes the run.
        """
        run = make(self.paths, self.sieved(observer) if sieved else observer, self.options)
        self.begin(run.pipeline, run.files, several or len(self.paths) > 1)
        return run

    def part(self, pipeline: Pipeline) -> Part | None:
        """Return the description of the selected part after ``pipeline`` has finished; None for everything."""
        return self.sieve.part(pipeline) if self.sieve is not None else None


def reading_of(
    paths: Sequence[Source],
    options: Options,
    where: str | Where | None = None,
    tags: Tags = None,
    tls_keys: KeyLogFiles = None,
) -> Reading:
    """Return a `Reading`; the arguments are those of `open`, and complete ``options``."""
    options.tls_keys = keys_of(tls_keys)
    options.naming = naming_of(tags)
    return Reading(paths, options, where)


class KeyLogError(Error, ValueError):
    """A file given for TLS keys has none."""


def read_tls_keys(paths: Sequence[str | os.PathLike[str]]) -> KeyLog:
    """Return the session keys of key logs (SSLKEYLOGFILE form). Keys that are appended later are read when they are needed.

    An empty file is accepted: its keys may still be written. Raises `KeyLogError` if a file has lines but no key, OSError if a
    file cannot be read, and ImportError with a hint if the package for decryption is missing.
    """
    from dissect.packets.source.growing import GrowingFile
    from dissect.protocols.tls import aead
    from dissect.protocols.tls.key_log import KeyLog

    if not aead.is_installed():
        raise ImportError(aead.NEEDS)
    for path in paths:
        found = KeyLog(files=[GrowingFile(path)])  # each file separately first, so that the error can name it
        found.look()
        if found.lines and found.wrong == found.lines:
            name = os.fspath(path)
            raise KeyLogError(
                f"{name}: not a TLS key log: no line has the form LABEL CLIENT_RANDOM SECRET (SSLKEYLOGFILE)"
            )
    keys = KeyLog(files=[GrowingFile(path) for path in paths])
    keys.look()
    return keys


def keys_of(given: KeyLogFiles) -> KeyLog | None:
    """Return the session keys of one key log or several, None for None. Raises what `read_tls_keys` raises."""
    if given is None:
        return None
    with of_family():
        return read_tls_keys([given] if isinstance(given, (str, os.PathLike)) else given)


def open(
    path: Source,
    *more: Source,
    pdus: bool = True,
    slow_ns: int = 1_000_000_000,
    scd: str | os.PathLike[str] | Dictionary | None = None,
    bind: str | os.PathLike[str] | None = None,
    checksums: bool = False,
    where: str | Where | None = None,
    tls_keys: KeyLogFiles = None,
    tags: Tags = None,
) -> Iterator[Event]:
    """Iterate the events of one capture or several: PDUs, transactions, operations, acts, findings, and ended connections.

    A capture is a path, an open binary file (``open(path, "rb")``, `io.BytesIO`), or an iterable of packets, each a tuple of
    time, LINKTYPE number and octets (`dissect.packets.source.given.Packet`). A file that was given open stays open.

    Events come in the order in which they become certain; a transaction follows its PDUs, an act the transaction that shows its
    outcome. ``pdus=False`` leaves the single PDUs out, which is faster. ``slow_ns``: an answer that takes longer is a finding
    (nanoseconds). With the dictionary ``scd`` and the bindings file ``bind`` SCD is decoded (docs/scd-traffic.md). With
    ``checksums``, packets whose TCP or UDP checksum is wrong are left out. ``tls_keys`` names files with the session keys of
    TLS (docs/tls.md). ``tags`` are files of tags, or the result of `dissect.meaning.tags.load_tags`:
    `dissect.engine.transactions.naming.named_values` names the values of a transaction by them. ``where`` selects, as option -Y
    does (docs/select.md): only events come that match, or that belong to a transaction that does. A PDU matches only if it has
    all the fields that the expression names.

    Wrong arguments raise at once: `SelectError` for the expression, `scd.DictionaryError` or
    `dissect.meaning.bindings.BindingError` for a dictionary or a bindings file, `dissect.meaning.tags.TagError` for files of
    tags, and what `read_tls_keys` raises for keys. A capture is opened only when the iteration reaches it: a file that cannot
    be read at all raises `CaptureError` then; damage inside a file is a finding. No file stays open if the iteration is stopped
    early.
    """
    queue = EventQueue(pdus)
    options = Options(slow_ns, decoder=decoder_of(scd, bind), checksums=checksums)
    return _events(reading_of([path, *more], options, where, tags, tls_keys).run(queue), queue)


def _events(run: Run, queue: EventQueue) -> Iterator[Event]:
    try:
        while run.step():
            yield from queue.events
            queue.events = []
        yield from queue.events
    finally:
        run.close()


def analyze(
    path: Source,
    *more: Source,
    slow_ns: int = 1_000_000_000,
    scd: str | os.PathLike[str] | Dictionary | None = None,
    bind: str | os.PathLike[str] | None = None,
    checksums: bool = False,
    where: str | Where | None = None,
    tls_keys: KeyLogFiles = None,
    tags: Tags = None,
) -> Analysis:
    """Sum up one capture or several in an `Analysis`: connections, transactions by function, answer times, findings, loss.

    ``slow_ns``: an answer later than this many nanoseconds is a finding. ``scd``, ``bind``, ``checksums``, ``tls_keys``,
    ``tags`` and ``where`` as for `open`: only the selected part is added up, and `Analysis.part` describes what was left out.
    Raises `CaptureError` when a file cannot be read at all; damage inside one is a finding.
    """
    analysis = Analysis()
    options = Options(slow_ns, decoder=decoder_of(scd, bind), checksums=checksums)
    reading = reading_of([path, *more], options, where, tags, tls_keys)
    run = reading.run(analysis)
    run.read()
    analysis.take(run.pipeline, run.files)
    analysis.part = reading.part(run.pipeline)
    return analysis


def devices(
    path: Source,
    *more: Source,
    checksums: bool = False,
    where: str | Where | None = None,
    tls_keys: KeyLogFiles = None,
    tags: Tags = None,
) -> Iterator[Device]:
    """Iterate the devices of one capture or several, the CPUs first: their facts, with the packets (docs/devices.md).

    The first device comes when everything was read. `dissect.meaning.inventory.collector.Inventory` is an observer that does
    the same in your own run; it also records who talked to whom. ``checksums``, ``tls_keys``, ``tags`` and ``where`` as for
    `open`. Raises `CaptureError` when a file cannot be read at all; damage inside a file ends the reading of that file.
    """
    from dissect.meaning.inventory.collector import Inventory

    inventory = Inventory()
    reading = reading_of([path, *more], Options(checksums=checksums), where, tags, tls_keys)
    return _devices(reading.run(inventory), inventory)


def _devices(run: Run, inventory: Inventory) -> Iterator[Device]:
    run.read()
    inventory.take(run.pipeline, run.files)
    yield from inventory.devices
