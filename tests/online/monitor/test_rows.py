from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.cells import cell_len

from dissect.engine.transactions.transaction import Transaction
from dissect.online.monitor import details, rows
from dissect.online.monitor.app import save
from dissect.online.monitor.lists import ConnectionFacts
from dissect.protocols.s7plus.tables import GET_VAR_SUBSTREAMED
from dissect.protocols.s7plus.value_tables import BLOB
from dissect.protocols.s7plus.values import Blob, Value, build_value
from dissect.wire.text import Clock
from tests.meaning.report.support import UNSAFE, begun
from tests.online.monitor.support import hostile, model_of, of_capture, of_packets
from tests.properties.messages import dt
from tests.protocols.s7plus import bodies
from tests.protocols.s7plus.pdus import asked, framed, told

NAMES = ("bsend", "client-killed", "nodes7-poll-missing", "password", "refused-full", "szl", "transfer", "two-clients")

WIDTHS = (80, 129, 130, 169, 170, 200, 400)


@given(st.text(), st.integers(0, 60), st.booleans())
def test_what_is_fitted_fills_its_place(text: str, width: int, right: bool) -> None:
    from dissect.wire.text import printable

    assert cell_len(rows.fit(printable(text), width, right)) == width


@pytest.mark.parametrize("name", NAMES)
def test_rows_fill_their_width_and_nothing_in_them_is_unsafe(name: str) -> None:
    session = of_capture(name)
    model = model_of(session)
    clock = Clock()
    found = model.findings(session.run.pipeline.finding_counts)
    connections = model.connections(session.status().now_ns)
    for width in WIDTHS:
        drawn = [rows.entry_row(entry, width, clock) for entry in model.entries[:50]]
        drawn += [rows.finding_row(one, width, clock) for one in found]
        for pieces in drawn:
            assert sum([cell_len(text) for text, _ in pieces]) == width
            assert UNSAFE.search(rows.joined(pieces)) is None
        for one in connections:
            text = "".join([text for text, _ in rows.connection_row(one, width, rows.Look(rows.sparks()))])
            assert cell_len(text) == width
            assert cell_len(rows.connection_heads("x", width)) == cell_len(text) - 1


@pytest.mark.parametrize("name", NAMES)
def test_details_of_everything(name: str) -> None:
    session = of_capture(name)
    model = model_of(session)
    found = model.findings(session.run.pipeline.finding_counts)
    pages = [details.entry_lines(entry) for entry in model.entries[:30]]
    pages += [details.connection_details(one, model.entries) for one in model.connections(session.status().now_ns)]
    pages += [details.finding_details(one) for one in found]
    for page in pages:
        assert page
        assert len(page) <= details.MAX_LINES
        assert [line.text for line in page if UNSAFE.search(line.text)] == []


def test_details_of_s7comm_plus_use_the_numbers_of_its_items() -> None:
    """The third variable of the subscription is the refused one, whatever stands before it in the notification."""
    model = model_of(of_capture("crafted/plus-plant"))
    pushed = next(entry for entry in model.entries if "DB1 LID 99: refused" in details.entry_lines(entry)[0].text)
    lines = [line.text.strip() for line in details.entry_lines(pushed)]
    assert lines[1:6] == [
        'item 1  DB1."level" = Real 42.5',
        'item 2  DB1."pump" = Bool true',
        "item 4  CPUexecUnit.DIS.OperatingState = DInt 8 RUN",
        "item 3  DB1 LID 99: refused",
        "item 3: 0x13 refused. The CPU refuses the item, and gives no reason.",
    ]
    assert lines[7].startswith("Push: packet 14  ")
    assert lines[8] == "offsets count from the start of the S7comm-plus PDU"  # how it came is not kept
    asked = next(entry for entry in model.entries if "GetMultiVariables" in details.entry_lines(entry)[0].text)
    assert [line.text.split(":")[0] for line in details.entry_lines(asked) if ": packet" in line.text] == [
        "Request",
        "Answer",
    ]


def test_a_hostile_device_is_quoted() -> None:
    model = model_of(of_packets(hostile()))
    told = rows.joined(rows.entry_row(model.entries[-1], 200, Clock()))
    assert "[red]X[/] \\x1b[2J" in told
    assert "REFUSED 0x8104" in told


def test_marks() -> None:
    def marks(name: str) -> str:
        model = model_of(of_capture(name), slow_ns=100_000_000)
        return "".join([rows.joined(rows.entry_row(entry, 80, Clock()))[:1] for entry in model.entries])

    assert marks("nodes7-poll-missing") == " =EE"
    assert "U" in marks("client-killed")
    assert "S" in marks("answer-slow")


@pytest.mark.parametrize(
    ("term", "glyphs"), [("linux", "12345678"), ("vt220", "12345678"), ("xterm-256color", "▁▂▃▄▅▆▇█")]
)
def test_a_plain_terminal_gets_digits(term: str, glyphs: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", term)
    assert rows.sparks() == glyphs
    session = of_capture("nodes7-poll-missing")
    (one,) = model_of(session).connections(session.status().now_ns)
    assert isinstance(one, ConnectionFacts)
    assert f"{glyphs[0]} " in rows.joined(rows.connection_row(one, 80, rows.Look(glyphs)))


def test_saving_never_overwrites_and_follows_no_link(tmp_path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    first = save(tmp_path, 0, ["one"])
    assert first.name == "s7dissect-19700101T000000Z.txt"
    (tmp_path / "s7dissect-19700101T000000Z-2.txt").symlink_to(tmp_path / "elsewhere")
    third = save(tmp_path, 0, ["three", "\udcff"])
    assert third.name == "s7dissect-19700101T000000Z-3.txt"
    assert not (tmp_path / "elsewhere").exists()
    assert first.read_text() == "one\n"
    assert third.read_text() == "three\n\\udcff\n"
    monkeypatch.setattr("dissect.online.monitor.app._TRIES", 3)
    with pytest.raises(FileExistsError, match="too many"):
        save(tmp_path, 0, [])


def test_a_narrow_row_has_room_for_what_a_push_says() -> None:
    """The group of a function stands before it where there is room, else behind Enter."""
    entries = model_of(of_capture("crafted/pushes")).entries
    pushes = [
        entry for entry in entries if isinstance(entry.what, Transaction) and "cyclic" in entry.what.function_name
    ]
    narrow = [rows.joined(rows.entry_row(entry, 80, Clock())) for entry in pushes]
    assert any("  cyclic transfer  push  job 4: item 1 = 00 aa" in line for line in narrow)
    assert all("cyclic services: " in rows.joined(rows.entry_row(entry, 160, Clock())) for entry in pushes)


def test_a_secret_that_is_read_back_is_not_in_the_details() -> None:
    """What is read stands there; the same answer to another request is shown."""
    talk = begun()
    answer = b"\0\0" + build_value(Value(0, BLOB, Blob(0, b"geheim"))) + bodies.end(3)
    for number, id_ in ((1, 7921), (2, 4196)):
        asks = bodies.get_stream(50, [id_]) + bodies.end(3)
        talk.send(0, dt(framed(asked(number, GET_VAR_SUBSTREAMED, body=asks), 3)))
        talk.send(1, dt(framed(told(number, GET_VAR_SUBSTREAMED, answer), 3)))
    model = model_of(of_packets(talk.packets()))
    entries = [entry for entry in model.entries if isinstance(entry.what, Transaction)]
    secret, other = ["\n".join([line.text for line in details.entry_lines(entry)]) for entry in entries[-2:]]
    said = b"geheim".hex(" ")
    assert said not in secret
    assert "CPUcommon.CPUPasswordFailsafe" in secret
    assert said in other
