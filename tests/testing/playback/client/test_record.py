"""What passes becomes packets: a session, and a file that reads the same."""

from __future__ import annotations

import socket
from pathlib import Path

from dissect.packets.source.pcapng_writer import PcapngWriter
from dissect.testing.golden import golden_text, read_session
from dissect.testing.golden.model import Session
from dissect.testing.playback.client.record import Record, RecordedConnection
from tests.meaning.report.support import WORD
from tests.properties import messages
from tests.properties.messages import dt

CLIENT, SERVER = ("127.0.0.1", 40_001), ("127.0.0.1", 102)
OURS, THEIRS = 0, 1


def conversed(talk: RecordedConnection) -> None:
    """Connect, set up, read."""
    for side, octets in (
        (OURS, messages.connect(0xE0)),
        (THEIRS, messages.connect(0xD0)),
        (OURS, dt(messages.setup(messages.JOB, 1))),
        (THEIRS, dt(messages.setup(messages.ACK_DATA, 1))),
        (OURS, dt(messages.read_job(2, [WORD]))),
        (THEIRS, dt(messages.read_answer(2, [WORD], [b"\x04\xd2"]))),
    ):
        talk.sent(side, octets)


def outcomes(session: Session) -> list[tuple[str, str]]:
    return [(each.function_name, each.outcome) for each in session.transactions]


def test_what_is_exchanged_is_a_session_with_the_addresses_of_the_sockets() -> None:
    record = Record("a server")
    talk = record.conversation(CLIENT, SERVER)
    conversed(talk)
    talk.closed(OURS)
    talk.closed(THEIRS)
    session = record.finish()
    (link,) = session.links
    assert session.name == "a server"
    assert talk.first_frame == 1
    assert record.links == {1: link}
    assert link.addresses == ("127.0.0.1:40001", "127.0.0.1:102")
    assert (link.begun, link.ended, link.ended_by) == (True, "fin", "client")
    assert outcomes(session) == [("Setup communication", "answered"), ("Read Var", "answered")]


def test_connections_over_ipv6_and_at_the_same_time_are_told_apart() -> None:
    record = Record("a server")
    talks = [
        record.conversation((host, 40_001, *more), (host, 102, *more))
        for host, more in (("127.0.0.1", ()), ("::1", (0, 0)))
    ]
    for talk in talks:
        conversed(talk)
    for talk in talks:
        talk.reset(THEIRS)
    session = record.finish()
    assert sorted(link.addresses[0] for link in session.links) == ["127.0.0.1:40001", "[::1]:40001"]
    assert {(link.ended, link.ended_by) for link in session.links} == {("reset", "server")}


def test_what_a_side_says_after_its_end_is_not_of_this_connection() -> None:
    record = Record("a server")
    talk = record.conversation(CLIENT, SERVER)
    conversed(talk)
    talk.closed(OURS)
    talk.closed(OURS)
    talk.sent(OURS, dt(messages.read_job(3, [WORD])))
    talk.sent(THEIRS, dt(messages.userdata(0, 0, 4, 5, bytes(40))))
    talk.reset(THEIRS)
    talk.reset(OURS)
    talk.closed(THEIRS)
    talk.sent(THEIRS, b"nothing")
    session = record.finish()
    assert [outcome for _, outcome in outcomes(session)] == ["answered", "answered", "unsolicited"]
    assert session.links[0].ended_by == "client"


def test_the_file_reads_like_the_session(tmp_path: Path) -> None:
    path = tmp_path / "a.pcapng"
    record = Record("a server", PcapngWriter(str(path)))
    talk = record.conversation(CLIENT, SERVER)
    conversed(talk)
    talk.closed(OURS)
    session = record.finish()
    assert record.trouble == ""
    assert golden_text(read_session(path)) == golden_text(session)


def test_times_never_go_back() -> None:
    record = Record("a server")
    conversed(record.conversation(CLIENT, SERVER))
    times = [each.time_ns or 0 for each in record.finish().transactions]
    assert times == sorted(times)
    assert min(times) > 0


class Full(PcapngWriter):
    """A file on a disk that is full from now on, or when it is closed."""

    at_once = True

    def packet(self, *arguments: object, **named: object) -> None:
        if self.at_once:
            raise OSError(28, "No space left on device")

    def close(self) -> None:
        super().close()
        raise OSError(5, "Input/output error")


def test_a_file_that_fails_is_told_once_and_costs_nothing_else(tmp_path: Path) -> None:
    for at_once, trouble in ((True, "No space left on device"), (False, "Input/output error")):
        writer = Full(str(tmp_path / f"{at_once}.pcapng"))
        writer.at_once = at_once
        record = Record("a server", writer)
        conversed(record.conversation(CLIENT, SERVER))
        assert len(record.finish().transactions) == 2
        assert record.trouble == trouble


def test_a_port_that_is_used_again_is_another_connection() -> None:
    record = Record("a server")
    frames = []
    for end in (OURS, THEIRS, OURS):
        talk = record.conversation(CLIENT, SERVER)
        conversed(talk)
        talk.reset(end)
        frames.append(talk.first_frame)
    session = record.finish()
    assert len(session.links) == 3
    assert [record.links[frame].ended_by for frame in frames] == ["client", "server", "client"]


def test_addresses_are_those_that_sockets_give() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener, socket.create_connection(listener.getsockname()) as one:
        record = Record("a server")
        conversed(record.conversation(one.getsockname(), one.getpeername()))
        (link,) = record.finish().links
        assert link.addresses == tuple(f"127.0.0.1:{end[1]}" for end in (one.getsockname(), one.getpeername()))
