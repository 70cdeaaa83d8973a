"""Shared by the tests of goldens: sessions of synthetic packets, and goldens with one change."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Final

from dissect.testing.golden import DiffOptions, Session, diff_sessions, parse_golden
from dissect.testing.golden.reading import SessionReader
from tests.meaning.report.support import begun, observed, read
from tests.properties.messages import Item
from tests.properties.packets import Flow, Packet, Talk

ROOT: Final = Path(__file__).resolve().parents[3]
RECORDED: Final = sorted(path.stem for path in (ROOT / "captures").glob("*.pcapng"))

#: A golden of every form, written by hand.
WRITTEN: Final = """s7dissect golden 1

connection 1
  protocol s7comm
  client TSAP <01 00>
  server TSAP <01 02>
  TPDU size 1024, asked 1024
  ends fin by client

1 client SETUP
  asks PDU 480, AmQ 1/1
  gets PDU 240, AmQ 1/1

2 client READ
  DB10.DBW4 INT = 1234
  DB10.DBD8 REAL = 3.5
  M20.1 BIT = true

3 client WRITE
  DB10.DBW4 INT = 5

4 client CPU functions: read SZL
  request Userdata
    parameters <00 01 12 04 11 44 01 00>
    data <ff 09 00 04 04 24 00 00>
  answer Userdata
    refused 0xd401
    parameters <00 01 12 08 12 84 01 00 00 00 00 00>
    data <0a 00 00 00>

5 client READ
  no answer: connection_closed
  DB10.DBW6 WORD
"""


def place(at: int, db: int = 10) -> Item:
    """Return a word of a DB."""
    return Item(0x04, 1, db, 0x84, at * 8)


def reads(*places: int, flow: Flow | None = None, db: int = 10) -> Talk:
    """Return a connection on which words are read one after another; each contains its own offset."""
    talk = begun(flow)
    for ref, at in enumerate(places, 1):
        read(talk, ref, place(at, db), at.to_bytes(2, "big"))
    return talk


def session(packets: Iterable[Packet]) -> Session:
    """Return the session of packets; our bugs raise."""
    reader = SessionReader("made")
    observed(reader, packets)
    return reader.finish()


def told(a: Session, b: Session, *ignore: str, latency: str | None = None) -> list[str]:
    """Return the differences as texts."""
    return [difference.text for difference in diff_sessions(a, b, DiffOptions(ignore, latency))]


def edited(text: str, old: str, new: str) -> Session:
    """Return the session of a golden in which ``old``, which occurs once, was replaced."""
    assert text.count(old) == 1, f"{old!r} stands there {text.count(old)} times"
    return parse_golden(text.replace(old, new), "edited")
