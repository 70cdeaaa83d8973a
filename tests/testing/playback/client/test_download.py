"""Downloads: what the PLC asks is answered as it was recorded, and nothing else that it asks is."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from dissect.protocols.s7.message import parse_pdu
from dissect.testing.golden.exchange import S7, Exchange
from dissect.testing.golden.model import Link, Session, Transaction
from dissect.testing.playback.client import Permissions, ReplayOutcome, Settings, load_recorded, make_plan
from dissect.testing.playback.client.download import Downloads, find_downloads
from dissect.testing.playback.client.permissions import NO_CONTROL
from dissect.testing.playback.client.plan import FOLLOWS_WITHHELD, NOT_WHOLE, SERVE, SERVER_ASKED, Part, plan_lines
from dissect.testing.playback.client.player import NOT_LOADED
from dissect.testing.playback.server.recording import load_recording
from dissect.testing.playback.server.service import Server
from tests.meaning.report.support import WORD, begun, read, saved
from tests.properties import messages
from tests.properties.messages import dt
from tests.testing.playback.client.support import ALL, CAPTURES, play, real_server, texts
from tests.testing.playback.client.test_player import Wire, serving

TRANSFER = CAPTURES / "transfer.pcapng"
CONTROL = Permissions(control=True)
SOON = Settings(timeout_s=0.2)
NAME = b"\x09_0A00001P"
BEGIN = b"\x1a\0\1\0\0\0\0\0" + NAME + b"\x0d1000012000004"
PIECE = b"\x1b\0\0\0\0\0\0\0" + NAME
ENDED = b"\x1c\0\0\0\0\0\0\0" + NAME
INSERT = b"\x28\0\0\0\0\0\0\xfd\0\x0a\1\x000A00001P\x05_INSE"
PIECES = (b"\0\x08\0\xfbABCDEFGH", b"\0\x04\0\xfbIJKL")


def job(reference: int, parameters: bytes) -> bytes:
    return messages.pdu(messages.JOB, reference, parameters)


def piece(reference: int, number: int) -> bytes:
    """Return the recorded answer with a piece, with another reference."""
    return messages.pdu(messages.ACK_DATA, reference, bytes((0x1B, number == 0)), PIECES[number])


def recording(path: Path, *, ended: bool = True) -> Path:
    """Write a download in two pieces: 1 setup, 2 request, 3 and 4 pieces, 5 its end, 6 the block linked in, 7 a read."""
    talk = begun()
    talk.send(0, dt(job(1, BEGIN))).send(1, dt(messages.pdu(messages.ACK_DATA, 1, b"\x1a")))
    for number in (0, 1):
        talk.send(1, dt(job(0x300 + number, PIECE))).send(0, dt(piece(0x300 + number, number)))
    if ended:
        talk.send(1, dt(job(0x302, ENDED))).send(0, dt(messages.pdu(messages.ACK_DATA, 0x302, b"\x1c")))
    talk.send(0, dt(job(2, INSERT))).send(1, dt(messages.pdu(messages.ACK_DATA, 2, b"\x28")))
    return saved(path, read(talk, 3).close(0).close(1).packets())


def loading(asks: Callable[[Wire], None]) -> Callable[[Wire], None]:
    """Return a server that accepts a download and goes on as ``asks``, then answers whatever comes."""

    def script(wire: Wire) -> None:
        wire.set_up()
        wire.say(messages.pdu(messages.ACK_DATA, parse_pdu(wire.pdu()).pdu_ref, b"\x1a"))
        asks(wire)
        while octets := wire.pdu():
            asked = parse_pdu(octets)
            if asked.function == 0x28:
                wire.say(messages.pdu(messages.ACK_DATA, asked.pdu_ref, b"\x28"))
            elif asked.function == 0x04:
                wire.say(messages.read_answer(asked.pdu_ref, [WORD], [b"\x04\xd2"]))

    return script


def with_answer(recorded: Session, number: int, was: bytes, is_: bytes) -> Session:
    """Return the recording in which the answer of a transaction says something else."""
    (transaction,) = [each for each in recorded.transactions if each.number == number]
    assert transaction.response.count(was) == 1
    transaction.exchange = Exchange(S7, transaction.request, transaction.response.replace(was, is_))
    return recorded


# ---- it works -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "jobs"), [("transfer", 5), ("crafted/coverage-functions", 24)])
def test_a_download_is_played_to_the_fake_plc(name: str, jobs: int) -> None:
    path = CAPTURES / f"{name}.pcapng"
    with Server(path) as server:
        outcome = play(path, server, ALL)
    assert texts(outcome) == []
    assert outcome.problems == []
    assert outcome.withheld == []
    assert (outcome.served, outcome.server_jobs) == (jobs, 0)
    assert outcome.summary()[0].endswith(f" answers, {jobs} jobs of the server answered")
    asked = [each for each in outcome.came.transactions if each.asked_by == "server"]
    assert [each.outcome for each in asked] == ["answered"] * jobs
    assert json.loads(json.dumps(outcome.as_dict()))["jobs_answered"] == jobs


def test_a_download_recorded_from_a_device_is_played(corpus: Path) -> None:
    path = corpus / "s7comm_downloading_block_db1.pcap"
    with Server(path) as server:
        outcome = play(path, server, ALL)
    assert texts(outcome) == []
    assert (outcome.served, outcome.server_jobs) == (4, 0)


def test_a_real_server_is_loaded_and_has_what_was_recorded() -> None:
    with real_server() as server:
        first = play(TRANSFER, server, ALL)
        after = play(TRANSFER, server)
        again = play(with_answer(load_recorded(TRANSFER), 11, b"\x20\x21\x22", b"\x20\xee\x22"), server, ALL)
        last = play(TRANSFER, server)
    assert texts(first) == []
    assert [(each.served, each.problems) for each in (first, again)] == [(5, []), (5, [])]
    uploads = [[each for each in outcome.came.transactions if each.function == 0x1E] for outcome in (after, last)]
    blocks = [upload[0].response for upload in uploads]
    assert bytes(range(60)) in blocks[0]
    assert bytes(range(60)).replace(b"\x20\x21\x22", b"\x20\xee\x22") in blocks[1]


def test_a_golden_of_a_download_is_played_as_well(tmp_path: Path) -> None:
    from dissect.testing.golden import golden_text, read_session

    golden = tmp_path / "transfer.s7.txt"
    golden.write_text(golden_text(read_session(TRANSFER)), "utf-8")
    with Server(TRANSFER) as server:
        outcome = play(golden, server, ALL)
    assert texts(outcome) == []
    assert outcome.served == 5


def test_the_server_gets_each_piece_with_the_reference_it_asked_with(tmp_path: Path) -> None:
    said: list[bytes] = []

    def asks(wire: Wire) -> None:
        for reference, parameters in ((0xBEEF, PIECE), (0x0002, PIECE), (0xBEEF, ENDED)):
            wire.say(job(reference, parameters))
            said.append(wire.pdu())

    with serving(loading(asks)) as (address, wires):
        outcome = play(recording(tmp_path / "a.pcapng"), address, CONTROL, SOON)
    assert said == [piece(0xBEEF, 0), piece(2, 1), messages.pdu(messages.ACK_DATA, 0xBEEF, b"\x1c")]
    assert texts(outcome) == []
    assert (outcome.served, outcome.server_jobs, outcome.requests, outcome.answered) == (3, 0, 4, 4)
    assert [octets[10] for octets in wires[0].asked if octets[1] == 1] == [0xF0, 0x1A, 0x28, 0x04]


def test_another_piece_is_what_the_server_gets_and_nothing_else(tmp_path: Path) -> None:
    said: list[bytes] = []

    def asks(wire: Wire) -> None:
        for parameters in (PIECE, PIECE, ENDED):
            wire.say(job(9, parameters))
            said.append(wire.pdu())

    recorded = with_answer(load_recorded(recording(tmp_path / "a.pcapng")), 4, b"IJKL", b"IjKL")
    with serving(loading(asks)) as (address, _):
        outcome = play(recorded, address, CONTROL, SOON)
    assert said == [
        piece(9, 0),
        piece(9, 1).replace(b"IJKL", b"IjKL"),
        messages.pdu(messages.ACK_DATA, 9, b"\x1c"),
    ]
    assert texts(outcome) == []
    with_other = load_recorded(recording(tmp_path / "b.pcapng"))
    for link in outcome.came.links:
        told = [each.response for each in link.transactions if each.asked_by == "server"]
        was = [each.response for each in with_other.transactions if each.asked_by == "server"]
        assert [one == other for one, other in zip(told, was, strict=True)] == [True, False, True]


# ---- and nothing more -----------------------------------------------------------------------------------------------


def unfinished(asks: Callable[[Wire], None], tmp_path: Path) -> tuple[ReplayOutcome, list[bytes]]:
    """Play to a server that does not ask as recorded; return also what came after the Request download."""
    with serving(loading(asks)) as (address, wires):
        outcome = play(recording(tmp_path / "a.pcapng"), address, CONTROL, SOON)
    assert outcome.problems == [f"connection 1: {NOT_LOADED}"]
    assert [one.transaction for one in outcome.not_sent] == [6, 7]
    assert texts(outcome) != []
    return outcome, wires[0].asked[2:]


def test_more_pieces_than_were_recorded_are_not_answered_and_told(tmp_path: Path) -> None:
    def asks(wire: Wire) -> None:
        for reference in (1, 2):
            wire.say(job(reference, PIECE))
            wire.pdu()
        wire.say(job(3, PIECE))

    outcome, after = unfinished(asks, tmp_path)
    assert after == [piece(1, 0), piece(2, 1)]
    assert (outcome.served, outcome.server_jobs) == (2, 1)
    assert "the server sent 1 more time; it was not answered" in outcome.summary()
    assert any("Download block" in line and "added" in line for line in texts(outcome))


@pytest.mark.parametrize(
    "other",
    [
        job(1, PIECE.replace(b"0A00001P", b"0A00002P")),  # another block
        job(1, PIECE.replace(b"\x1b\0", b"\x1b\1")),  # another parameter
        job(1, ENDED.replace(b"\x1c\0\0\0", b"\x1c\0\xd2\0")),  # an end that went wrong
        job(1, PIECE) + b"\0",  # something behind its end
        job(1, PIECE)[:-1],  # not all of it
        job(1, INSERT),
        messages.userdata(1, 1, 4, 1, b"\x00\x11\x00\x00"),
        messages.pdu(messages.ACK_DATA, 0x999, b"\x1b\0"),
    ],
)
def test_what_is_not_like_a_recorded_job_is_not_answered(other: bytes, tmp_path: Path) -> None:
    outcome, after = unfinished(lambda wire: wire.say(other), tmp_path)
    assert after == []
    assert outcome.served == 0
    assert outcome.server_jobs == (other[1] != messages.ACK_DATA)


@pytest.mark.parametrize("answer", [messages.pdu(messages.ACK, 2, b"", error=0xD241), b""])
def test_a_download_that_is_not_accepted_is_not_gone_on_with(answer: bytes, tmp_path: Path) -> None:
    def script(wire: Wire) -> None:
        wire.set_up()
        wire.pdu()
        if answer:
            wire.say(answer)
        wire.say(job(1, PIECE))

    with serving(script) as (address, wires):
        outcome = play(recording(tmp_path / "a.pcapng"), address, CONTROL, SOON)
    assert len(wires[0].asked) == 2
    assert outcome.served == 0
    assert outcome.answered == 1 + bool(answer)
    assert outcome.problems == [f"connection 1: {NOT_LOADED}"]
    assert [one.transaction for one in outcome.not_sent] == [6, 7]


def test_a_job_before_the_download_is_accepted_is_not_answered(tmp_path: Path) -> None:
    def script(wire: Wire) -> None:
        wire.set_up()
        asked = parse_pdu(wire.pdu())
        wire.say(job(1, PIECE))
        wire.say(messages.pdu(messages.ACK_DATA, asked.pdu_ref, b"\x1a"))

    with serving(script) as (address, wires):
        outcome = play(recording(tmp_path / "a.pcapng"), address, CONTROL, SOON)
    assert len(wires[0].asked) == 2
    assert (outcome.served, outcome.server_jobs) == (0, 1)


@pytest.mark.parametrize("permissions", [Permissions(), Permissions(write=True)])
def test_without_control_all_of_it_is_withheld(permissions: Permissions, tmp_path: Path) -> None:
    path = recording(tmp_path / "a.pcapng")
    with Server(path) as server:
        outcome = play(path, server, permissions)
        functions = [request.octets[10] for request in server.requests]
    assert functions == [0xF0, 0x04]
    assert texts(outcome) == []
    assert {one.transaction: one.reason for one in outcome.withheld} == {
        2: NO_CONTROL,
        3: FOLLOWS_WITHHELD,
        4: FOLLOWS_WITHHELD,
        5: FOLLOWS_WITHHELD,
        6: NO_CONTROL,
    }
    assert (outcome.served, outcome.server_jobs) == (0, 0)


def test_a_server_that_asks_without_a_download_is_not_answered_whatever_is_allowed(tmp_path: Path) -> None:
    def script(wire: Wire) -> None:
        wire.set_up()
        wire.say(job(1, PIECE))
        wire.pdu()

    with serving(script) as (address, wires):
        outcome = play(recording(tmp_path / "a.pcapng"), address, Permissions(), SOON)
    assert all(parse_pdu(octets).rosctr == messages.JOB for octets in wires[0].asked)
    assert (outcome.served, outcome.server_jobs) == (0, 1)


def test_pieces_that_do_not_fit_what_was_granted_keep_the_download_here() -> None:
    served = load_recording(TRANSFER)
    for step in served.scripts[0].steps:
        if step.request[10] == 0xF0:
            step.answer = step.answer[:-2] + b"\x00\xf0"
    with Server(served) as server:
        outcome = play(TRANSFER, server, ALL, SOON)
        begun_ = [request.octets[19:27] for request in server.requests if request.octets[10] == 0x1A]
    assert begun_ == [b"_0A00010", b"_0A00099"]
    assert outcome.served == 2
    told = {one.transaction: one.reason for one in outcome.withheld}
    assert told[13] == "a piece of 480 bytes does not fit the PDU length of 240 that was granted"
    assert [told[number] for number in (14, 15, 16)] == [FOLLOWS_WITHHELD] * 3


# ---- the recorded ones ----------------------------------------------------------------------------------------------


def test_a_download_that_is_not_whole_in_the_recording_does_not_begin(tmp_path: Path) -> None:
    path = recording(tmp_path / "a.pcapng", ended=False)
    with Server(path) as server:
        outcome = play(path, server, ALL)
        functions = [request.octets[10] for request in server.requests]
    assert functions == [0xF0, 0x28, 0x04]
    assert {one.transaction: one.reason for one in outcome.withheld} == {
        2: NOT_WHOLE,
        3: FOLLOWS_WITHHELD,
        4: FOLLOWS_WITHHELD,
    }
    assert texts(outcome) == []


def test_a_dry_run_says_what_would_be_answered() -> None:
    plan = make_plan(load_recorded(TRANSFER))
    assert "  answer transaction 11, Download block DB 10, passive, which the PLC requests" in plan_lines(plan, ALL)
    assert f"  withhold transaction 11, Download block DB 10, passive: {FOLLOWS_WITHHELD}" in plan_lines(
        plan, Permissions()
    )


def link(*transactions: tuple[str, bytes, bytes]) -> Link:
    one = Link()
    one.number, one.protocol = 1, "S7comm"
    for number, (asked_by, request, answer) in enumerate(transactions, 1):
        transaction = Transaction(one, asked_by, Exchange(S7, request, answer), "answered" if answer else "unanswered")
        transaction.number = number
        one.transactions.append(transaction)
    return one


ACCEPTED = messages.pdu(messages.ACK_DATA, 1, b"\x1a")
THE_END = messages.pdu(messages.ACK_DATA, 1, b"\x1c")


def test_the_same_block_again_has_its_own_pieces_and_what_is_left_of_the_first_is_gone() -> None:
    one = link(
        ("client", job(1, BEGIN), ACCEPTED),
        ("server", job(1, PIECE), piece(1, 0)),
        ("server", job(2, ENDED), THE_END),
        ("client", job(2, BEGIN), ACCEPTED),
        ("server", job(3, PIECE), piece(1, 1)),
        ("server", job(4, ENDED), THE_END),
        ("server", job(5, PIECE), piece(1, 1)),
    )
    found = find_downloads(one.transactions)
    assert [[each.number for each in download.jobs] for download in found] == [[2, 3], [5, 6]]
    live = Downloads(found)
    assert live.next(job(9, PIECE)) is None
    live.answered(one.transactions[0], ACCEPTED)
    live.answered(one.transactions[3], ACCEPTED)
    assert live.next(job(9, PIECE)) is one.transactions[4]
    assert live.next(job(9, PIECE)) is None
    assert not live.goes_on(found[0])
    live.answered(one.transactions[3], messages.pdu(messages.ACK, 1, b"", error=0xD241))
    assert live.next(job(9, ENDED)) is None
    steps = Part(one)
    assert [step.transaction.number for step in steps.steps if step.kind == SERVE] == [2, 3, 5, 6]
    assert [(told.transaction, told.reason) for told in steps.withheld] == [(7, SERVER_ASKED)]


def test_a_client_that_sends_the_pieces_unasked_is_played_as_it_did() -> None:
    one = link(
        ("client", job(1, BEGIN), ACCEPTED),
        ("client", job(2, PIECE), messages.pdu(messages.ACK_DATA, 1, b"\x1b\0")),
        ("client", job(3, ENDED), THE_END),
    )
    assert find_downloads(one.transactions)[0].whole
    assert [step.kind for step in Part(one).steps] == ["ask"] * 3


@pytest.mark.parametrize("octets", [b"", b"2", job(1, b""), job(1, b"\x1b"), job(1, PIECE[:12]), b"\xff" * 40])
def test_whatever_a_server_says_is_looked_at_without_raising(octets: bytes) -> None:
    one = link(("client", job(1, BEGIN), ACCEPTED), ("server", job(1, ENDED), THE_END))
    live = Downloads(find_downloads(one.transactions))
    live.answered(one.transactions[0], ACCEPTED)
    assert live.next(octets) is None
    assert not CONTROL.answers(octets) or parse_pdu(octets).function == 0x1B
