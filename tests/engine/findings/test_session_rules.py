from __future__ import annotations

import pytest

from dissect.engine.findings.reporter import Finding
from tests.engine.transactions.talk import (
    CLIENT,
    CONFIRM,
    CONNECT,
    MS,
    SECOND,
    SERVER,
    Talk,
    ack,
    dbw,
    dt,
    granted,
    head,
    read,
    setup,
    tpkt,
    userdata,
    words,
)
from tests.growth import assert_growth


def found(talk: Talk, slug: str) -> list[Finding]:
    return [finding for finding in talk.findings if finding.slug == slug]


# ---- setup ----------------------------------------------------------------------------------------------------------


def begun() -> Talk:
    talk = Talk()
    talk.hello()
    talk.connect()
    return talk


def test_data_before_setup_is_said_once() -> None:
    talk = begun()
    asked = talk.ask(read(1, dbw(1, 0)))
    talk.tell(words(1, 1))
    talk.ask(read(2, dbw(1, 0)))
    (finding,) = found(talk, "session.data_before_setup")
    assert (finding.frames, finding.connection, finding.detail) == ([asked], 1, "Read Var")


def test_setup_first_is_right() -> None:
    talk = begun()
    talk.ask(setup(1))
    talk.tell(granted(1))
    talk.ask(read(1, dbw(1, 0)))
    assert found(talk, "session.data_before_setup") == []
    connection = talk.pipeline.table.all_open()[0].connection
    assert connection.setup_asked is not None
    assert connection.setup_asked.pdu_length == 480


def test_a_setup_that_is_none_asks_for_nothing() -> None:
    talk = begun()
    talk.ask(setup(1))
    talk.tell(granted(1))
    talk.ask(setup(2, 3, 3, 960)[:-3])
    connection = talk.pipeline.table.all_open()[0].connection
    assert connection.setup_asked is not None
    assert connection.setup_asked.pdu_length == 480


def test_mid_stream_nobody_knows_whether_there_was_a_setup() -> None:
    talk = Talk()
    talk.ask(read(1, dbw(1, 0)))
    assert found(talk, "session.data_before_setup") == []


def test_a_connect_request_is_a_known_start() -> None:
    talk = Talk()
    talk.connect()
    talk.ask(read(1, dbw(1, 0)))
    assert len(found(talk, "session.data_before_setup")) == 1


def test_a_setup_in_a_hole_is_not_missed() -> None:
    talk = begun()
    talk.lose(CLIENT, setup(1))
    talk.ask(read(1, dbw(1, 0)))
    for _ in range(3):
        talk.packet(SERVER, after_ns=60 * MS)
    talk.finish()
    assert "stream.hole" in talk.slugs()
    assert found(talk, "session.data_before_setup") == []


@pytest.mark.parametrize(
    ("asked", "told", "detail"),
    [
        ((1, 1, 240), (1, 1, 480), "PDU length 480 granted, 240 requested"),
        ((1, 1, 480), (1, 1, 63), "PDU length 63 granted"),
        ((1, 1, 480), (1, 1, 0), "PDU length 0 granted"),
        ((1, 1, 480), (1, 2, 480), "AmQ 1/2 granted, 1/1 requested"),
        ((1, 1, 480), (2, 1, 480), "AmQ 2/1 granted, 1/1 requested"),
    ],
)
def test_a_grant_that_cannot_be_right(asked: tuple[int, int, int], told: tuple[int, int, int], detail: str) -> None:
    talk = begun()
    first = talk.ask(setup(1, *asked))
    second = talk.tell(granted(1, *told))
    (finding,) = found(talk, "session.bad_grant")
    assert (finding.frames, finding.detail) == ([first, second], detail)


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        # Seen in captures (reference 3.4).
        ((1, 1, 480), (1, 1, 480)),
        ((8, 8, 960), (3, 3, 240)),
        ((1, 3, 480), (1, 2, 240)),
        ((1, 1, 64), (1, 1, 64)),
    ],
)
def test_a_grant_of_what_was_asked_or_less(asked: tuple[int, int, int], told: tuple[int, int, int]) -> None:
    talk = begun()
    talk.ask(setup(1, *asked))
    talk.tell(granted(1, *told))
    assert talk.findings == []


def test_a_refused_setup_is_no_grant() -> None:
    talk = begun()
    talk.ask(setup(1))
    talk.tell(ack(1, 0x8104))
    assert found(talk, "session.bad_grant") == []


# ---- open jobs ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("allowed", [1, 2, 3, 8])
def test_more_requests_open_than_granted(allowed: int) -> None:
    talk = Talk()
    talk.open(1, allowed)
    for number in range(allowed):
        talk.ask(read(number, dbw(1, 0)))
    assert talk.findings == []
    one_more = talk.ask(userdata(99, head(1, 4, 1)))  # userdata requests count too
    (finding,) = found(talk, "session.too_many_jobs")
    assert (finding.frames, finding.detail) == ([one_more], f"more requests pending than the {allowed} granted (AmQ)")


def test_a_grant_of_thousands_is_counted_as_well() -> None:
    talk = Talk()
    talk.open(1, 100)
    talk.ask(*(read(number, dbw(1, 0)) for number in range(100)))
    assert talk.findings == []
    talk.ask(read(100, dbw(1, 0)))
    assert len(found(talk, "session.too_many_jobs")) == 1


def test_requests_of_one_packet_are_counted_each_and_told_once() -> None:
    talk = Talk()
    talk.open(1, 2)
    first = talk.ask(*(read(number, dbw(1, 0)) for number in range(6)))
    second = talk.ask(read(6, dbw(1, 0)))
    assert [finding.frames for finding in found(talk, "session.too_many_jobs")] == [[first], [second]]
    assert talk.pipeline.finding_counts["session.too_many_jobs"] == 5


def test_the_other_direction_has_a_grant_of_its_own() -> None:
    talk = Talk()
    talk.open(2, 1)
    for number in range(2):
        talk.tell(userdata(number, head(1, 6, 1)))
    assert talk.findings == []
    talk.tell(userdata(3, head(1, 6, 1)))
    assert len(found(talk, "session.too_many_jobs")) == 1


def test_answers_pushes_and_acknowledgements_are_no_requests() -> None:
    talk = Talk()
    talk.open(1, 1)
    talk.ask(read(1, dbw(1, 0)))
    talk.packet(CLIENT, bytes.fromhex("0300000702f000"))
    talk.tell(userdata(0, head(0, 2, 1)))
    talk.tell(words(1, 1))
    talk.ask(read(2, dbw(1, 0)))
    assert talk.slugs() == ["operation.stray_push"]


def test_without_a_captured_grant_nothing_is_said() -> None:
    talk = Talk()
    for number in range(20):
        talk.ask(read(number, dbw(1, 0)))
    assert talk.findings == []


def test_a_request_that_was_given_up_is_not_kept_open() -> None:
    """One lost answer must not make every later request one too many."""
    talk = Talk()
    talk.open(1, 1)
    talk.ask(read(1, dbw(1, 0)))
    talk.wait(3 * SECOND)
    for number in range(2, 20):
        talk.ask(read(number, dbw(1, 0)))
        talk.tell(words(number, 1))
    assert found(talk, "session.too_many_jobs") == []


def test_a_request_whose_answer_is_in_a_hole_is_not_open() -> None:
    talk = Talk()
    talk.open(1, 1)
    talk.ask(read(1, dbw(1, 0)))
    talk.lose(SERVER, words(1, 1))
    talk.packet(CLIENT, after_ns=10 * MS)
    for number in range(2, 20):
        talk.ask(read(number, dbw(1, 0)))
        talk.tell(words(number, 1))
    assert "stream.hole" in talk.slugs()
    assert found(talk, "session.too_many_jobs") == []


# ---- ports ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("ports", "count"), [((50000, 102), 0), ((102, 50000), 0), ((50000, 10102), 1)])
def test_unusual_ports(ports: tuple[int, int], count: int) -> None:
    talk = Talk(*ports)
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    details = [finding.detail for finding in found(talk, "session.unusual_port")]
    assert details == ["server 10.0.0.2:10102"] * count


def test_an_unusual_port_of_nobody_knows_whom() -> None:
    talk = Talk(40000, 40001)
    talk.tell(words(1, 1))
    talk.ask(read(2, dbw(1, 0)))
    (finding,) = found(talk, "session.unusual_port")
    assert finding.detail == "between 10.0.0.2:40001 and 10.0.0.1:40000"


# ---- the end --------------------------------------------------------------------------------------------------------

REFUSAL = tpkt(bytes.fromhex("068000010000") + b"\x82")


def test_a_refused_connect_request() -> None:
    talk = Talk()
    talk.hello()
    talk.packet(CLIENT, CONNECT)
    frame = talk.packet(SERVER, REFUSAL)
    (finding,) = found(talk, "cotp.refused")
    assert finding.frames == [frame]
    assert finding.detail.startswith("10.0.0.2:102 refuses for called TSAP 01.02 (PG, rack 0 slot 2): ")
    assert found(talk, "cotp.disconnected") == []
    talk.finish()
    assert talk.connections[0].refused != ""


@pytest.mark.parametrize(
    ("side", "reason", "answered", "told"),
    [
        (CLIENT, 0x00, True, 0),  # as python-snap7 ends
        (CLIENT, 0x80, True, 0),
        (CLIENT, 0x80, False, 1),
        (CLIENT, 0x85, True, 1),
        (SERVER, 0x80, True, 1),
        (SERVER, 0x00, False, 1),
    ],
)
def test_a_client_that_takes_its_leave_is_not_told(side: int, reason: int, answered: bool, told: int) -> None:
    talk = Talk()
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    if answered:
        talk.tell(words(1, 1))
    talk.packet(side, tpkt(bytes.fromhex("068000010000") + bytes((reason,))))
    assert len(found(talk, "cotp.disconnected")) == told
    talk.finish()
    assert talk.connections[0].iso_ended.startswith(f"DR from 10.0.0.{side + 1}")


def test_a_disconnect_request_after_data() -> None:
    talk = Talk()
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    frame = talk.packet(CLIENT, REFUSAL)
    (finding,) = found(talk, "cotp.disconnected")
    assert (finding.frames, finding.detail.startswith("10.0.0.1:50000: ")) == ([frame], True)
    assert found(talk, "cotp.refused") == []
    talk.finish()
    assert talk.connections[0].iso_ended.startswith("DR from 10.0.0.1:50000: ")


def test_an_error_tpdu() -> None:
    talk = Talk()
    talk.open()
    talk.packet(SERVER, tpkt(bytes.fromhex("0470000102")))
    (finding,) = found(talk, "cotp.error")
    assert finding.detail != ""
    talk.finish()
    assert talk.connections[0].iso_ended.startswith("ER from 10.0.0.2:102: ")


@pytest.mark.parametrize(("slug", "octets"), [("cotp.disconnected", "028000"), ("cotp.error", "027000")])
def test_a_tpdu_that_ends_before_its_reason(slug: str, octets: str) -> None:
    talk = Talk()
    talk.open()
    talk.packet(SERVER, tpkt(bytes.fromhex(octets)))
    (finding,) = found(talk, slug)
    assert finding.detail.endswith("no reason given")
    talk.finish()
    assert talk.connections[0].iso_ended.endswith("from 10.0.0.2:102: no reason given")


def test_a_request_without_what_it_is_to_be_compared_with() -> None:
    talk = Talk()
    talk.packet(CLIENT, tpkt(bytes.fromhex("02e000")))
    talk.packet(SERVER, CONFIRM)
    assert found(talk, "cotp.bad_confirm") == []
    talk.finish()
    assert talk.connections[0].cr_ref == -1


@pytest.mark.parametrize("side", [CLIENT, SERVER])
@pytest.mark.parametrize(("pdus", "count"), [(2, 0), (3, 1), (9, 1)])
def test_one_side_only(side: int, pdus: int, count: int) -> None:
    talk = Talk()
    for number in range(pdus):
        talk.packet(side, dt(words(number, 1) if side == SERVER else read(number, dbw(1, 0))))
    talk.finish()
    findings = found(talk, "capture.one_sided")
    assert len(findings) == count
    for finding in findings:
        assert finding.frames == [1, pdus]
        assert finding.detail == f"only packets from 10.0.0.{1 + side}:{(50000, 102)[side]} were captured"
    if count:
        assert set(talk.slugs()) == {"capture.one_sided"}


def test_both_sides() -> None:
    talk = Talk()
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(words(1, 1))
    talk.ask(read(2, dbw(1, 0)))
    talk.finish()
    assert found(talk, "capture.one_sided") == []


def test_a_hole_does_not_make_a_flood_slow() -> None:
    """Only a few of the open requests are looked at for each one that is asked."""

    def flood(hole: bool) -> None:
        talk = Talk()
        talk.open(8, 8)
        if hole:
            talk.lose(SERVER, words(9, 1))
            talk.tell(words(8, 1))
        for _ in range(3):
            talk.packet(CLIENT, after_ns=60 * MS)
            talk.packet(SERVER, after_ns=60 * MS)
        talk.flood(3_000)
        assert ("stream.hole" in talk.slugs()) is hole
        assert talk.pipeline.finding_counts["session.too_many_jobs"] == 3_000 - 8

    assert_growth(lambda: flood(hole=False), lambda: flood(hole=True), 4)
