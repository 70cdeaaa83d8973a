"""Shared by the tests of the screens: finished sessions over our own captures and simulated talks, and what is visible."""

from __future__ import annotations

import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

from dissect.engine.pipeline import Options
from dissect.online.live.events import Event
from dissect.online.live.session import Session
from dissect.online.monitor.app import MonitorApp
from dissect.online.monitor.model import Model
from dissect.packets.source.files import open_capture
from dissect.packets.source.packet import PacketSink
from tests.meaning.report.support import begun
from tests.online.live.support import Clock, Line
from tests.properties.messages import dt, pdu
from tests.properties.packets import Packet

CAPTURES: Final = Path(__file__).resolve().parents[3] / "captures"

SIZES: Final = ((80, 24), (200, 60))

#: Text from a device that could mislead a reader, a terminal or a terminal library.
HOSTILE: Final = "[red]X[/] \x1b[2J\x07\u202e"


def ended(session: Session) -> Session:
    """Return a session that was started and has read everything; none of its events was taken."""
    session.start()
    end = time.monotonic() + 60
    while session.running:
        assert time.monotonic() < end, "the session does not end"
        time.sleep(0.005)
    return session


def of_capture(name: str, **more: Any) -> Session:
    """Return the session over one of our captures."""
    path = CAPTURES / f"{name}.pcapng"
    return ended(Session(lambda: open_capture(str(path)), Options(strict=True), name=path.name, **more))


def of_packets(packets: Iterable[Packet]) -> Session:
    """Return the session over packets."""
    line = Line(Clock(), [list(packets)], ends=True)
    return ended(Session(lambda: line, Options(strict=True), name="fake0"))


class Waiting(Line):
    """A line that takes its time, as real ones do, so that the screen has time as well."""

    def step(self, sink: PacketSink) -> bool:
        time.sleep(0.01)
        return super().step(sink)


def live(*batches: Iterable[Packet]) -> tuple[Session, Line]:
    """Return a session that was started and continues, silent after ``batches``, and its line."""
    line = Waiting(Clock(), [list(batch) for batch in batches])
    session = Session(lambda: line, Options(strict=True), name="fake0")
    session.start()
    return session, line


def hostile() -> list[Packet]:
    """Return a talk in which the name of a PI service is `HOSTILE`, and the device refuses it."""
    name = HOSTILE.encode("utf-8")
    talk = begun()
    talk.send(0, dt(pdu(1, 7, bytes(6).join([b"\x28", b"\xfd\x00\x00"]) + bytes((len(name),)) + name)))
    talk.send(1, dt(pdu(3, 7, b"\x28", error=0x8104)))
    return talk.packets()


def events_of(session: Session) -> list[Event]:
    """Return everything that happened in a session that is over."""
    return session.poll(0.0, 1_000_000)


def model_of(session: Session, **options: Any) -> Model:
    """Return the model of everything that happened in a session that is over."""
    model = Model(**options)
    model.take(events_of(session))
    return model


def screen(app: MonitorApp) -> list[str]:
    """Return the content of the screen, line by line."""
    width, height = app.size
    strips = app.screen._compositor.render_strips()
    assert len(strips) == height
    lines = [strip.text for strip in strips]
    assert {len(line) for line in lines if line.isascii()} <= {width}
    return [line.rstrip() for line in lines]
