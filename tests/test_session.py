"""Captures joined to the pipeline: `open`, `analyze` and `Run` over one file and over many."""

from __future__ import annotations

import gc
import gzip
import struct
from collections.abc import Callable, Iterable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import pytest

import dissect
from dissect import scd
from dissect.engine.findings.reporter import Finding
from dissect.engine.pipeline import Options
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.payloads import ScdMessage
from dissect.engine.transactions.transaction import Transaction
from dissect.files.session import Run
from dissect.meaning.bindings import BindingError
from dissect.packets.source.packet import CONTINUES_NS, CaptureError
from dissect.protocols.s7.message import Pdu
from tests.properties.books import Record, check_books, facts, told, true
from tests.properties.messages import ACK_DATA, JOB, Item, connect, dt, read_answer, read_job, setup
from tests.properties.packets import EPOCH_NS, MS, Packet, Talk, captured
from tests.properties.traffic import Conversation

CAPTURES: Final = Path(__file__).parent.parent / "captures"

SECOND: Final = 1_000_000_000
OWN: Final = Path(__file__).parents[1] / "captures" / "item-errors.pcapng"
WORD: Final = Item(0x04, 1, 10, 0x84, 32)


def pcap(packets: Iterable[Packet]) -> bytes:
    """Return a pcap file with nanoseconds."""
    pieces = [struct.pack("<IHHiIII", 0xA1B23C4D, 2, 4, 0, 0, 262144, 1)]
    for packet in packets:
        seconds, rest = divmod(packet.time_ns, SECOND)
        pieces += [struct.pack("<IIII", seconds, rest, len(packet.octets), packet.wire_length), packet.octets]
    return b"".join(pieces)


def pcapng(packets: Iterable[Packet], comments: dict[int, str]) -> bytes:
    """Return a pcapng file with nanoseconds; packets have the ``comments`` of their number, counted from 1."""

    def block(kind: int, body: bytes) -> bytes:
        size = 12 + len(body)
        return struct.pack("<II", kind, size) + body + struct.pack("<I", size)

    def option(code: int, value: bytes) -> bytes:
        return struct.pack("<HH", code, len(value)) + value + bytes(-len(value) % 4)

    pieces = [
        block(0x0A0D0D0A, struct.pack("<IHHq", 0x1A2B3C4D, 1, 0, -1)),
        block(1, struct.pack("<HHI", 1, 0, 0) + option(9, b"\x09") + option(0, b"")),
    ]
    for number, packet in enumerate(packets, 1):
        size = len(packet.octets)
        head = struct.pack("<IIIII", 0, packet.time_ns >> 32, packet.time_ns & 0xFFFFFFFF, size, packet.wire_length)
        options = option(1, comments[number].encode()) + option(0, b"") if number in comments else b""
        pieces.append(block(6, head + packet.octets + bytes(-size % 4) + options))
    return b"".join(pieces)


def polled(count: int) -> list[Packet]:
    """Return a connection that is set up and polled ``count`` times, without an end."""
    talk = Talk().handshake().send(0, connect(0xE0)).send(1, connect(0xD0))
    talk.send(0, dt(setup(JOB, 0))).send(1, dt(setup(ACK_DATA, 0)))
    for ref in range(1, count + 1):
        talk.send(0, dt(read_job(ref, [WORD]))).send(1, dt(read_answer(ref, [WORD], [b"\x00\x2a"])))
    return talk.packets()


class Files:
    """Writes captures into a folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._count = 0

    def __call__(self, octets: bytes | Iterable[Packet], suffix: str = ".pcap") -> str:
        self._count += 1
        path = self._folder / f"{self._count}{suffix}"
        path.write_bytes(octets if isinstance(octets, bytes) else pcap(octets))
        return str(path)


@pytest.fixture
def write(tmp_path: Path) -> Files:
    """Write a capture; gives its path."""
    return Files(tmp_path)


def shifted(packets: Iterable[Packet], by_ns: int) -> list[Packet]:
    """Return packets at other times."""
    return [packet._replace(time_ns=packet.time_ns + by_ns) for packet in packets]


# ---- one file -------------------------------------------------------------------------------------------------------


def test_open_gives_every_event_in_order(write: Files) -> None:
    talk = Talk().handshake().send(0, dt(read_job(1, [WORD]))).send(1, dt(read_answer(1, [WORD], [0x0A]))).close()
    path = write(talk.packets())
    events = list(dissect.open(path))
    assert [type(event) for event in events] == [Pdu, Finding, Finding, Pdu, Transaction, Finding, Connection]
    request, begun, before, answer, one, refused, connection = events
    assert isinstance(request, Pdu)
    assert isinstance(answer, Pdu)
    assert (request.frame, request.side, request.rosctr) == (4, 0, JOB)
    assert (answer.frame, answer.side, answer.rosctr) == (5, 1, ACK_DATA)
    assert isinstance(begun, Finding)
    assert begun.slug == "cotp.bad_start"
    assert isinstance(before, Finding)
    assert before.slug == "session.data_before_setup"
    assert isinstance(one, Transaction)
    assert one.latency_ns == MS
    assert isinstance(refused, Finding)
    assert refused.slug == "transaction.item_error"
    assert isinstance(connection, Connection)
    assert connection.tcp.ended == "fin"
    without = [type(event) for event in dissect.open(path, pdus=False)]
    assert without == [Finding, Finding, Transaction, Finding, Connection]


def test_open_knows_what_is_slow(write: Files) -> None:
    path = write(polled(1))
    assert [event for event in dissect.open(path) if isinstance(event, Finding)] == []
    slow = [event.slug for event in dissect.open(path, slow_ns=MS // 2) if isinstance(event, Finding)]
    assert slow == ["transaction.slow"] * 2
    assert dissect.analyze(path, slow_ns=MS // 2).as_dict()["findings"] == {"transaction.slow": 2}


def test_analyze_folds_a_file(write: Files) -> None:
    path = write(polled(10))
    analysis = dissect.analyze(path)
    assert (analysis.total, analysis.answered) == (11, 11)
    counted = analysis.as_dict()
    assert counted["packets"] == {
        "read": 27,
        "used": {"payload": 24, "no_payload": 3},
        "ignored": {},
        "truncated": 0,
    }
    assert analysis.pipeline is not None
    check_books(analysis.pipeline)
    (file,) = analysis.files
    assert (file.name, file.first_frame, file.packets, file.octets, file.damage) == (
        path,
        1,
        27,
        Path(path).stat().st_size,
        "",
    )


def test_a_run_reads_step_by_step_and_may_end_early(write: Files) -> None:
    record = Record()
    run = Run([write(polled(20_000))], record, Options(strict=True))
    assert run.step()
    read = run.pipeline.frames
    assert 0 < read < 40_007
    assert run.files[0].packets == read
    run.finish()
    run.finish()
    assert run.pipeline.frames == read
    check_books(run.pipeline, record)
    assert len(record.closed) == 1


def test_a_run_of_one_file_takes_its_path(write: Files) -> None:
    path = write(polled(1))
    for one in (path, Path(path)):
        run = Run(one, Record())
        run.read()
        assert [file.name for file in run.files] == [path]


def test_what_cannot_be_read_at_all_is_told(write: Files, tmp_path: Path) -> None:
    for path in (str(tmp_path / "nothing"), write(b""), write(b"no capture at all"), str(tmp_path)):
        with pytest.raises(CaptureError, match=Path(path).name):
            dissect.analyze(path)
        with pytest.raises(CaptureError):
            list(dissect.open(path))


@pytest.mark.filterwarnings("error::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("reader", [dissect.open, dissect.values], ids=["open", "values"])
def test_whoever_stops_half_way_leaves_no_file_open(write: Files, reader: Callable[..., Iterator[object]]) -> None:
    path = write(polled(20))
    for _ in reader(path):
        break
    other = reader(path)
    next(other)
    del other
    gc.collect()


def test_what_is_wrong_with_an_argument_is_told_before_the_first_event(write: Files) -> None:
    with pytest.raises(dissect.SelectError):
        dissect.open(write(polled(20)), where="nothing == 1")
    with pytest.raises(dissect.SelectError):
        dissect.devices(write(polled(20)), where="nothing == 1")
    with pytest.raises(ValueError, match="needs both a dictionary"):
        dissect.open(write(polled(20)), scd="plant.toml")


def test_a_capture_without_packets_is_empty(write: Files) -> None:
    analysis = dissect.analyze(write([]))
    assert (analysis.total, analysis.as_dict()["first_time"]) == (0, None)


def test_comments_are_passed_on_with_their_frame(write: Files) -> None:
    class Comments(Record):
        def __init__(self) -> None:
            super().__init__()
            self.comments: list[tuple[int, str]] = []

        def comment(self, frame: int, text: str) -> None:
            self.comments.append((int(frame), text))

    record = Comments()
    packets = polled(1)
    first = write(pcapng(packets[:5], {1: "here it begins", 5: "the fifth"}), ".pcapng")
    second = write(pcapng(packets[5:], {2: "the seventh"}), ".pcapng")
    run = Run([first, second], record, Options(strict=True))
    while run.step():
        pass
    assert record.comments == [(1, "here it begins"), (5, "the fifth"), (7, "the seventh")]
    assert [one.outcome for one in record.transactions] == ["answered"] * 2


# ---- many files -----------------------------------------------------------------------------------------------------


def summed_up(*paths: str) -> dict[str, object]:
    """Return what is told of captures that does not name a file or a place in one."""
    told = dissect.analyze(*paths).as_dict()
    keys = (
        "first_time",
        "last_time",
        "packets",
        "tsdus",
        "tpdus",
        "s7",
        "transactions",
        "latency_ns",
        "functions",
        "loss",
    )
    found = {key: told[key] for key in (*keys, "findings")}
    transactions = [event for event in dissect.open(*paths, pdus=False) if isinstance(event, Transaction)]
    found["transactions one by one"] = [(facts(one), one.request_frame, one.response_frame) for one in transactions]
    return found


def test_the_files_of_a_ring_buffer_continue_their_connections(write: Files) -> None:
    packets = polled(30)
    whole = summed_up(write(packets))
    for cuts in ([20], [1, 2, 3], [8, 21, 50], [4, 4]):
        edges = [0, *cuts, len(packets)]
        assert summed_up(*[write(packets[start:end]) for start, end in pairwise(edges)]) == whole, cuts


@pytest.mark.parametrize(
    ("gap_ns", "continues"),
    [
        (MS, True),
        (CONTINUES_NS, True),
        (CONTINUES_NS + 1, False),
        (3600 * SECOND, False),
        (-SECOND, False),
        (-3600 * SECOND, False),
    ],
)
def test_a_file_continues_within_a_minute(write: Files, gap_ns: int, continues: bool) -> None:
    packets = polled(4)
    first, second = packets[:10], packets[10:]
    second = shifted(second, first[-1].time_ns + gap_ns - second[0].time_ns)
    analysis = dissect.analyze(write(first), write(second))
    assert analysis.pipeline is not None
    check_books(analysis.pipeline)
    assert len(analysis.connections) == (1 if continues else 2)
    # The tenth packet asks, the eleventh answers.
    assert analysis.unanswered == analysis.orphans == (0 if continues else 1)
    assert analysis.pipeline.finding_counts.get("capture.time_backwards") is None


def test_unrelated_files_stand_for_themselves(write: Files) -> None:
    packets = polled(3)
    paths = [write(shifted(packets, -day * 86_400 * SECOND)) for day in range(3)]
    analysis = dissect.analyze(*paths)
    assert analysis.answered == 12
    assert [connection.number for connection in analysis.connections] == [1, 2, 3]
    assert analysis.as_dict()["findings"] == {}


def test_frames_are_located_in_their_file(write: Files) -> None:
    packets = polled(3)
    paths = [write(packets), write([]), write(shifted(packets, 3600 * SECOND)), write(shifted(packets, 7200 * SECOND))]
    analysis = dissect.analyze(*paths)
    count = len(packets)
    assert [file.first_frame for file in analysis.files] == [1, count + 1, count + 1, 2 * count + 1]
    assert analysis.locate(1) == (paths[0], 1)
    assert analysis.locate(count) == (paths[0], count)
    assert analysis.locate(count + 1) == (paths[2], 1)
    assert analysis.locate(3 * count) == (paths[3], count)


def test_a_damaged_file_gives_what_it_holds_and_is_told(write: Files) -> None:
    packets = polled(4)
    whole = pcap(packets)
    first = write(whole[: len(whole) - 60])
    second = write(shifted(packets, 3600 * SECOND))
    analysis = dissect.analyze(first, second)
    assert analysis.pipeline is not None
    check_books(analysis.pipeline)
    assert analysis.total == 10
    damaged, sound = analysis.files
    assert damaged.damage != ""
    assert sound.damage == ""
    assert damaged.packets == len(packets) - 1
    (finding,) = [finding for finding in analysis.findings if finding.slug == "capture.damaged"]
    assert finding.detail == f"{first}: {damaged.damage}"
    assert analysis.locate(finding.frames[0]) == (first, damaged.packets)


def test_damage_before_the_first_packet(write: Files) -> None:
    whole = pcap(polled(1))
    analysis = dissect.analyze(write(whole[:30]))
    assert analysis.as_dict()["findings"] == {"capture.damaged": 1}
    assert analysis.findings[0].frames == []


def test_an_unreadable_file_among_others_stops_the_run(write: Files) -> None:
    record = Record()
    run = Run([write(polled(2)), write(b"nothing of the kind")], record, Options(strict=True))

    def read_all() -> None:
        while run.step():
            pass

    with pytest.raises(CaptureError):
        read_all()
    # What was read before can still be closed and told.
    run.finish()
    check_books(run.pipeline, record)
    assert len(record.transactions) == 3


def test_compressed_files_are_read_like_plain_ones(write: Files) -> None:
    packets = polled(5)
    packed = write(gzip.compress(pcap(packets)), ".pcap.gz")
    assert summed_up(packed) == summed_up(write(packets))


def test_a_conversation_survives_the_way_through_a_file(write: Files) -> None:
    made = Conversation(polled_flow := Talk().flow).begin()
    for ref in range(1, 50):
        made.exchange(0, read_job(ref, [WORD]), read_answer(ref, [WORD], [ref.to_bytes(2, "big")]))
    talk = Talk(polled_flow).handshake()
    for side, octets in made.messages:
        talk.send(side, octets)
    transactions = [event for event in dissect.open(write(captured(talk.segments))) if isinstance(event, Transaction)]
    assert told(transactions) == true([made])
    assert transactions[0].request_ns == EPOCH_NS + 5 * MS


# ---- SCD ------------------------------------------------------------------------------------------------------------

PLANT: Final = Path(__file__).resolve().parents[1] / "captures" / "scd"
DICT, BIND, CAPTURE = (str(PLANT / name) for name in ("plant.toml", "plant.bind.toml", "plant.pcapng"))


@pytest.mark.parametrize("compiled", [False, True])
def test_scd_as_somebody_uses_it(compiled: bool) -> None:
    """A dictionary is a file or one that is loaded already; every value comes with its name, unit and text."""
    dictionary: str | scd.Dictionary = scd.load(DICT) if compiled else DICT
    modes: dict[str, object] = {}
    messages = 0
    for event in dissect.open(CAPTURE, scd=dictionary, bind=BIND):
        if isinstance(event, ScdMessage):
            messages += 1
            modes.update({row.name: row.text for row in event.values if row.name == "Режим 1"})
        elif isinstance(event, Transaction):
            for found in event.scd:
                assert found.message.error is None or found.subject == "read 0x6fff:0"
    assert messages == 48 + 2 + 4 + 2  # those of their own; what stands in S7 is in its transactions
    assert modes == {"Режим 1": "автомат"}
    folded: dict[str, Any] = dict(dissect.analyze(CAPTURE, scd=dictionary, bind=BIND).as_dict())
    assert folded["scd"]["dictionary"] == "Насосная"


def test_scd_messages_come_before_their_transaction() -> None:
    told = list(dissect.open(CAPTURE, scd=DICT, bind=BIND))
    for event in told:
        if isinstance(event, Transaction) and event.is_scd:
            before = told[: told.index(event)]
            assert all(any(found is one for one in before) for found in event.scd)


def test_without_pdus_there_are_no_scd_messages_of_their_own() -> None:
    told = list(dissect.open(CAPTURE, scd=DICT, bind=BIND, pdus=False))
    assert not [event for event in told if isinstance(event, ScdMessage)]
    assert sum(len(event.scd) for event in told if isinstance(event, Transaction)) == 62


@pytest.mark.parametrize("options", [{"scd": DICT}, {"bind": BIND}])
def test_one_half_of_the_options_is_an_error(options: dict[str, str]) -> None:
    with pytest.raises(ValueError, match="needs both a dictionary"):
        list(dissect.open(CAPTURE, **options))  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="needs both a dictionary"):
        dissect.analyze(CAPTURE, **options)  # type: ignore[arg-type]


def test_a_wrong_dictionary_or_bindings_file_is_told_before_anything_is_read() -> None:
    with pytest.raises(BindingError):
        list(dissect.open("nowhere.pcapng", scd=DICT, bind=DICT))
    with pytest.raises(scd.DictionaryError):
        list(dissect.open("nowhere.pcapng", scd=BIND, bind=BIND))


class Failing(dissect.Observer):
    """An observer of a user with a mistake."""

    def __init__(self, where: str) -> None:
        super().__init__()
        self.where = where

    def _fail(self, where: str) -> None:
        if where == self.where:
            raise KeyError("mine")

    def transaction(self, transaction: dissect.Transaction) -> None:
        self._fail("transaction")

    def finding(self, finding: dissect.Finding) -> None:
        self._fail("finding")

    def connection_closed(self, connection: dissect.Connection) -> None:
        self._fail("connection_closed")


@pytest.mark.parametrize("where", ["transaction", "finding", "connection_closed"])
def test_a_mistake_in_an_observer_of_ones_own_reaches_the_program(where: str) -> None:
    with pytest.raises(KeyError, match="mine"):
        dissect.Run(OWN, Failing(where)).read()


def test_a_bug_of_the_analyzer_stays_a_finding_beside_an_observer_of_ones_own() -> None:
    run = dissect.Run(OWN, Failing("nowhere"))
    run.pipeline.exchange.note_bug(RuntimeError("ours"), 0, 0)
    run.read()
    assert run.pipeline.exchange.bug is None
    assert run.pipeline.finding_counts["internal.bug"] == 1


def test_acts_are_events_behind_their_transactions() -> None:
    events = list(dissect.open(CAPTURES / "crafted" / "plus-plant.pcapng", pdus=False))
    acts = [event for event in events if isinstance(event, dissect.Act)]
    assert [(act.kind, act.outcome) for act in acts] == [
        ("stop", "accepted"),
        ("start", "accepted"),
        ("download", "accepted"),
    ]
    numbers = [event.number if isinstance(event, dissect.Transaction) else 0 for event in events]
    for act in acts:
        assert all(numbers.index(number) < events.index(act) for number in act.transactions)


def test_only_acts_of_selected_transactions_are_events() -> None:
    path = CAPTURES / "crafted" / "plus-plant.pcapng"
    acts = [event for event in dissect.open(path, pdus=False, where="number == 17") if isinstance(event, dissect.Act)]
    assert [act.kind for act in acts] == ["stop"]
