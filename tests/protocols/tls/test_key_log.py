"""Key logs: the form, what is wrong in one, what is written later. Never a secret in words."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.packets.source.growing import GrowingFile
from dissect.protocols.tls import key_log
from dissect.protocols.tls.key_log import MASTER, KeyLog, KeyRing

RANDOM = bytes(range(32))
SECRET = bytes(range(100, 148))
LINE = f"CLIENT_RANDOM {RANDOM.hex()} {SECRET.hex()}"


def log(text: bytes | str) -> KeyLog:
    found = KeyLog()
    found.add(text if isinstance(text, bytes) else text.encode())
    return found


@pytest.mark.parametrize(
    "text",
    [
        LINE,
        f"{LINE}\n",
        f"# made by a program\n\n{LINE}\r\n",
        f"\r{LINE}\r",
        f"\ufeff{LINE}\n",
        f"CLIENT_RANDOM {RANDOM.hex().upper()} {SECRET.hex().upper()}\n\0\0",
    ],
)
def test_forms_of_a_line(text: str) -> None:
    found = log(text)
    assert found.find(RANDOM) == {MASTER: SECRET}
    assert (found.lines, found.wrong, len(found), found.revision) == (1, 0, 1, 1)


@pytest.mark.parametrize(
    "line",
    [
        "hello world",
        f"CLIENT_RANDOM {RANDOM.hex()}",
        f"CLIENT_RANDOM {RANDOM.hex()[2:]} {SECRET.hex()}",
        f"CLIENT_RANDOM {RANDOM.hex()} {SECRET.hex()[:-1]}",
        f"CLIENT_RANDOM {RANDOM.hex()} {SECRET.hex()}00",
        f"SOMETHING_ELSE {RANDOM.hex()} {SECRET.hex()}",
        f"client_random {RANDOM.hex()} {SECRET.hex()}",
        f"CLIENT_RANDOM  {RANDOM.hex()} {SECRET.hex()}",
        "\xd4\xc3\xb2\xa1 a capture",
    ],
)
def test_lines_of_another_form_are_counted_and_hide_no_other(line: str) -> None:
    found = log(f"{line}\n{LINE}\n".encode("latin-1"))
    assert (found.lines, found.wrong, len(found)) == (2, 1, 1)
    assert found.find(RANDOM)[MASTER] == SECRET


def test_labels_that_open_nothing_are_known() -> None:
    found = log(f"EXPORTER_SECRET {RANDOM.hex()} {SECRET.hex()}\nRSA {RANDOM.hex()[:16]} {SECRET.hex()}\n")
    assert (found.lines, found.wrong, len(found)) == (2, 0, 0)


def test_a_later_secret_takes_the_place_of_an_earlier_one() -> None:
    found = log(LINE)
    found.add(f"CLIENT_RANDOM {RANDOM.hex()} {bytes(48).hex()}\n".encode())
    assert found.find(RANDOM) == {MASTER: bytes(48)}
    assert found.revision == 2


def test_what_is_written_while_it_is_read() -> None:
    """Cut at any place: nothing is wrong, and the secret is there at the latest when its line is whole."""
    text = f"# log\n{LINE}\nSERVER_TRAFFIC_SECRET_0 {RANDOM.hex()} {SECRET.hex()}\n".encode()
    for cut in range(len(text) + 1):
        pieces = iter((text[:cut], text[cut:]))
        found = KeyLog([lambda pieces=pieces: next(pieces, b"")])  # type: ignore[misc]
        found.look()
        found.look()
        found.look()
        assert found.find(RANDOM) == {MASTER: SECRET, "SERVER_TRAFFIC_SECRET_0": SECRET}, cut
        assert (found.lines, found.wrong) == (2, 0), cut


def test_the_half_line_of_a_file_that_was_begun_anew_is_gone(tmp_path: Path) -> None:
    path = tmp_path / "keys"
    path.write_text("# some program\n" + LINE[:100])
    found = KeyLog(files=[GrowingFile(path)])
    found.look()
    assert (found.lines, found.unfinished) == (0, 1)
    path.write_text("")
    found.look()
    assert found.unfinished == 0
    path.write_text(f"{LINE}\n")
    found.look()
    assert (found.find(RANDOM), found.lines, found.wrong) == ({MASTER: SECRET}, 1, 0)


def test_a_last_line_without_its_end_counts() -> None:
    pieces = iter((LINE.encode(),))
    found = KeyLog([lambda: next(pieces, b"")])
    found.look()
    assert found.find(RANDOM) == {MASTER: SECRET}


@pytest.mark.parametrize(
    ("end", "unfinished", "wrong"),
    [
        (LINE[:-1], 1, 0),
        (LINE[:5], 1, 0),
        ("CLIENT_RANDOM ", 1, 0),
        ("# a comment", 0, 0),
        (" \0", 0, 0),
        ("\xd4\xc3\xb2\xa1 a capture", 0, 1),
        (f"{LINE}0011", 1, 0),
        ("client_random", 0, 1),
    ],
)
def test_a_last_line_that_gives_nothing(end: str, unfinished: int, wrong: int) -> None:
    """What may still become a line is counted as such, what cannot is wrong at once."""
    pieces = iter((end.encode("latin-1"), b"", b"\n"))
    found = KeyLog([lambda: next(pieces, b"")])
    found.look()
    found.look()
    assert (len(found), found.unfinished, found.wrong) == (0, unfinished, wrong)
    found.look()
    assert (found.unfinished, found.wrong) == (0, unfinished + wrong)


def test_lines_of_two_files_do_not_run_into_each_other() -> None:
    other = bytes(32)
    first = iter((LINE.encode()[:50], LINE.encode()[50:] + b"\n"))
    second = iter((f"CLIENT_RANDOM {other.hex()} {SECRET.hex()}\n".encode(),))
    found = KeyLog([lambda: next(first, b""), lambda: next(second, b"")])
    found.look()
    found.look()
    assert (len(found), found.wrong) == (2, 0)


def test_sessions_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(key_log, "MAX_SESSIONS", 3)
    found = KeyLog()
    for number in range(5):
        found.add(f"CLIENT_RANDOM {bytes(31).hex()}{number:02x} {SECRET.hex()}\n".encode())
    assert (len(found), found.forgotten) == (3, 2)
    assert found.find(bytes(31) + b"\0") == {}
    assert found.find(bytes(31) + b"\x04") == {MASTER: SECRET}


def test_a_ring_has_what_is_given_and_what_the_capture_holds() -> None:
    ring = KeyRing()
    assert (ring.asked, len(ring), ring.find(RANDOM)) == (False, 0, {})
    ring.found.add(LINE.encode())
    assert (ring.asked, len(ring), ring.find(RANDOM)) == (True, 1, {MASTER: SECRET})
    both = KeyRing(log(f"SERVER_TRAFFIC_SECRET_0 {RANDOM.hex()} {SECRET.hex()}"))
    both.found.add(LINE.encode())
    assert both.find(RANDOM) == {MASTER: SECRET, "SERVER_TRAFFIC_SECRET_0": SECRET}
    assert KeyRing(KeyLog()).asked


def test_no_secret_in_words() -> None:
    found = log(LINE)
    assert SECRET.hex() not in repr(found).lower()
    assert repr(found) == "KeyLog(1 sessions)"


@given(st.binary(max_size=300), st.binary(max_size=300))
def test_anything_may_stand_in_a_file(first: bytes, second: bytes) -> None:
    pieces = iter((first, second))
    found = KeyLog([lambda: next(pieces, b"")])
    found.look()
    found.look()
    found.add(first)
    assert found.wrong <= found.lines
