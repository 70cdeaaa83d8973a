"""Sequence numbers begin anywhere and wrap: whichever packet of a conversation has number 0, the same is told of it.

Each scene is captured once with small numbers. Then it is captured again for each place of its streams, with that place at 0.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import pytest

from dissect.engine.options import Options
from dissect.engine.pipeline import Pipeline
from tests.engine.transactions.talk import (
    ACK,
    CLIENT,
    CONFIRM,
    CONNECT,
    FIN,
    MASK,
    MS,
    RST,
    SECOND,
    SERVER,
    SYN,
    Talk,
    dbw,
    dt,
    granted,
    read,
    setup,
    words,
)

#: Where the streams begin when a scene is captured first.
BEGINS: Final = (100_000, 7_000_000)
HTTP: Final = b"GET / HTTP/1.0\r\n"


class Placed(Talk):
    """Begins at given numbers, and remembers the places of its packets and of what they acknowledge."""

    def __init__(self, begins: tuple[int, int] = BEGINS) -> None:
        super().__init__()
        self.begins = begins
        self.seq = list(begins)
        self.places: list[set[int]] = [{0}, {0}]

    def packet(
        self,
        side: int,
        payload: bytes = b"",
        flags: int = ACK,
        seq: int | None = None,
        after_ns: int = MS,
        cut: int = 0,
    ) -> int:
        at = self.seq[side] if seq is None else seq
        self.places[side] |= {at - self.begins[side], at - self.begins[side] + len(payload)}
        self.places[1 - side].add(self.seq[1 - side] - self.begins[1 - side])
        return super().packet(side, payload, flags, seq, after_ns, cut)


def polled(talk: Talk, *refs: int) -> None:
    for ref in refs:
        talk.ask(read(ref, dbw(1, 0)))
        talk.tell(words(ref, 1))


def told(talk: Talk) -> Any:
    """All that is told, without numbers of TCP."""
    pipeline = talk.pipeline
    connections = [
        (
            int(one.number), one.tcp.ended, int(one.tcp.ended_by), int(one.tcp.ended_frame), int(one.tcp.packets),
            int(one.tcp.first_frame), int(one.tcp.last_frame), one.answered, one.unanswered, one.protocol,
            int(one.tcp.initiator), one.mid_stream, one.ending.how if one.ending is not None else "",
        )
        for one in talk.connections
    ]  # fmt: skip
    findings = [
        (one.slug, one.frames, one.detail.split(" at TCP sequence number ")[0], one.time_ns) for one in talk.findings
    ]
    transactions = [
        (one.function_name, one.outcome, one.reason, one.request_frame, one.response_frame, one.unseen)
        for one in talk.transactions
    ]
    return (
        connections, findings, transactions, pipeline.counters.packet_counts(), pipeline.counters.octets.as_dict(),
        pipeline.counters.bare.found(), pipeline.counters.bare.ends, int(pipeline.connections.count),
    )  # fmt: skip


# ---- scenes ---------------------------------------------------------------------------------------------------------


def a_whole_session(talk: Talk) -> None:
    talk.open(2, 2)
    polled(talk, 1, 2)
    talk.close()


def the_server_speaks_first(talk: Talk) -> None:
    talk.hello()
    for ref in (1, 2):
        talk.tell(words(ref, 1))
    talk.packet(CLIENT)
    talk.packet(SERVER)
    talk.close()


def met_in_its_midst(talk: Talk) -> None:
    talk.tell(words(9, 1))
    polled(talk, 1, 2)
    talk.packet(CLIENT, flags=RST | ACK)


def out_of_order(talk: Talk) -> None:
    talk.open(8, 8)
    at = talk.seq[CLIENT]
    first, second = dt(read(1, dbw(1, 0))), dt(read(2, dbw(1, 0)))
    talk.packet(CLIENT, second, seq=at + len(first))
    talk.packet(CLIENT, first, seq=at)
    talk.packet(CLIENT, (first + second)[10:40], seq=at + 10)  # once more, in other pieces
    talk.seq[CLIENT] = at + len(first + second)
    talk.tell(words(1, 1), words(2, 1))
    at = talk.seq[SERVER]
    third = dt(words(3, 1))
    talk.ask(read(3, dbw(1, 0)))
    talk.packet(SERVER, third[5:], seq=at + 5)
    talk.packet(SERVER, third[:9], seq=at)  # overlaps
    talk.seq[SERVER] = at + len(third)
    talk.close()


def sent_again(talk: Talk) -> None:
    talk.open(8, 8)
    octets = dt(read(1, dbw(1, 0)))
    at = talk.seq[CLIENT]
    talk.packet(CLIENT, octets)
    for after_ns in (MS, 300 * MS, 600 * MS):
        talk.packet(CLIENT, octets, seq=at, after_ns=after_ns)
    talk.packet(CLIENT, octets[:20] + bytes(11), seq=at)  # a different copy
    talk.packet(SERVER, CONFIRM, seq=talk.seq[SERVER] - 200)  # from before the beginning
    talk.wait(3 * SECOND)
    talk.close()


def with_a_gap(talk: Talk) -> None:
    talk.open(8, 8)
    polled(talk, 1)
    talk.lose(CLIENT, read(2, dbw(1, 0)))
    talk.lose(SERVER, words(2, 1))
    polled(talk, 3, 4)
    talk.packet(CLIENT, dt(read(5, dbw(1, 0)))[:20])
    talk.seq[CLIENT] += 11
    polled(talk, 6)
    talk.close()


def a_gap_that_only_acknowledgements_show(talk: Talk) -> None:
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    talk.lose(SERVER, words(1, 1))
    talk.packet(CLIENT)
    talk.close()


def a_first_answer_that_is_lost(talk: Talk) -> None:
    talk.ask(read(1, dbw(1, 0)))
    talk.lose(SERVER, words(1, 1))
    talk.ask(read(2, dbw(1, 0)))
    talk.tell(words(2, 1))
    talk.close()


def an_empty_packet_behind_what_is_lost(talk: Talk) -> None:
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    talk.acked = [talk.seq[SERVER], None]
    talk.lose(SERVER, words(1, 1))
    talk.packet(SERVER)
    talk.packet(CLIENT)


def far_ahead(talk: Talk) -> None:
    talk.open(8, 8)
    polled(talk, 1)
    for number in range(3):
        talk.packet(CLIENT, dt(read(9, dbw(1, 0))), seq=talk.seq[CLIENT] + 3_000_000 + 31 * number)
    polled(talk, 2, 3)
    talk.close()


def a_packet_that_the_capture_cut(talk: Talk) -> None:
    talk.open()
    for cut in (9, 25):
        talk.packet(CLIENT, dt(read(1, dbw(1, 0))), cut=cut)
        talk.tell(words(1, 1))
    talk.close()


def keep_alives(talk: Talk) -> None:
    for octets in (b"", b"\0"):
        talk.packet(CLIENT, octets, seq=talk.seq[CLIENT] - 1, after_ns=30 * SECOND)
        talk.packet(SERVER)


def keep_alives_of_an_open_connection(talk: Talk) -> None:
    talk.open()
    for _ in range(2):
        talk.packet(CLIENT, b"\0", seq=talk.seq[CLIENT] - 1, after_ns=30 * SECOND)
        talk.packet(SERVER)
    polled(talk, 1)
    talk.close()


def keep_alives_behind_a_handshake(talk: Talk) -> None:
    talk.hello()
    for octets in (b"\0", b""):
        talk.packet(CLIENT, octets, seq=talk.seq[CLIENT] - 1, after_ns=30 * SECOND)
        talk.packet(SERVER)


def opened_and_closed(talk: Talk) -> None:
    talk.hello()
    talk.packet(CLIENT, flags=FIN | ACK)
    talk.packet(SERVER, flags=FIN | ACK)
    talk.packet(CLIENT)


def refused_and_unanswered(talk: Talk) -> None:
    for _ in range(3):
        talk.packet(CLIENT, flags=SYN, seq=talk.seq[CLIENT], after_ns=SECOND)
    talk.seq[CLIENT] += 1
    talk.packet(SERVER, flags=RST | ACK)


def a_syn_behind_its_answer(talk: Talk) -> None:
    at = talk.seq[CLIENT]
    talk.seq[CLIENT] += 1
    talk.packet(SERVER, flags=SYN | ACK)
    talk.packet(CLIENT, flags=SYN, seq=at)
    talk.connect()
    polled(talk, 1)
    talk.packet(CLIENT, flags=SYN, seq=at)  # once more
    talk.close()


def false_ends(talk: Talk) -> None:
    talk.open(8, 8)
    polled(talk, 1)
    for side, distance, flags in ((SERVER, 100, RST), (CLIENT, -60, FIN | ACK), (CLIENT, 1, RST | ACK)):
        talk.packet(side, flags=flags, seq=talk.seq[side] + distance)
        polled(talk, 2, 3)
    talk.packet(SERVER, flags=RST, seq=talk.seq[SERVER] + 5_000_000)
    polled(talk, 4)
    talk.close()


def a_true_end_with_a_wrong_number(talk: Talk) -> None:
    talk.open()
    talk.ask(read(2, dbw(1, 0)))
    talk.packet(SERVER, flags=FIN | ACK, seq=talk.seq[SERVER] + 27)
    talk.packet(CLIENT)
    talk.silence(12 * SECOND)


def octets_behind_a_reset(talk: Talk) -> None:
    talk.open()
    talk.packet(SERVER, flags=RST)
    talk.packet(CLIENT, dt(read(1, dbw(1, 0))))
    talk.packet(CLIENT, dt(read(2, dbw(1, 0))), seq=talk.seq[CLIENT] + 10_000_000)


def a_forged_syn(talk: Talk) -> None:
    talk.open(8, 8)
    polled(talk, 1)
    talk.packet(CLIENT, flags=SYN, seq=talk.seq[CLIENT] + 50_000_000)
    talk.packet(SERVER)
    polled(talk, 2, 3)
    talk.close()


def a_forged_syn_with_a_number_nearby(talk: Talk) -> None:
    talk.open(8, 8)
    polled(talk, 1)
    talk.packet(CLIENT, flags=SYN, seq=talk.seq[CLIENT] + 1000)
    talk.packet(CLIENT, dt(read(9, dbw(1, 0))), seq=talk.seq[CLIENT] + 1050)
    polled(talk, 2)
    talk.close()


def a_new_connection(talk: Talk) -> None:
    talk.open()
    polled(talk, 1)
    talk.seq = [talk.seq[CLIENT] + 50_000_000, talk.seq[SERVER] + 70_000_000]
    talk.open()
    polled(talk, 2)
    talk.close()


def a_new_connection_that_only_its_octets_show(talk: Talk) -> None:
    talk.open()
    polled(talk, 1)
    talk.seq = [talk.seq[CLIENT] + 50_000_000, talk.seq[SERVER] + 70_000_000]
    talk.packet(CLIENT, flags=SYN)
    talk.seq[SERVER] += 1
    polled(talk, 2, 3)
    talk.close()


def the_same_that_the_answers_show(talk: Talk) -> None:
    talk.open()
    polled(talk, 1)
    talk.seq = [talk.seq[CLIENT] + 50_000_000, talk.seq[SERVER] + 70_000_000]
    talk.packet(CLIENT, flags=SYN)
    talk.seq[CLIENT] += 31
    talk.tell(words(2, 1))
    polled(talk, 3)
    talk.close()


def a_connect_request_far_away(talk: Talk) -> None:
    talk.open()
    polled(talk, 1)
    talk.seq = [talk.seq[CLIENT] + 50_000_000, talk.seq[SERVER] - 5_000_000]
    talk.connect()
    polled(talk, 2)
    talk.close()


def two_vlans(talk: Talk) -> None:
    """Each direction in one of its own."""
    for side, payload, flags in (
        (CLIENT, b"", SYN), (SERVER, b"", SYN | ACK), (CLIENT, CONNECT, ACK), (SERVER, CONFIRM, ACK),
        (CLIENT, dt(setup(0)), ACK), (SERVER, dt(granted(0)), ACK), (SERVER, b"", FIN | ACK), (CLIENT, b"", RST),
    ):  # fmt: skip
        talk.vlan = 10 + side
        talk.packet(side, payload, flags)


def two_vlans_from_the_midst_on(talk: Talk) -> None:
    for ref in range(1, 5):
        talk.vlan = 10
        talk.ask(read(ref, dbw(1, 0)))
        talk.vlan = 11
        talk.tell(words(ref, 1))
    talk.packet(SERVER, flags=RST)


def every_packet_in_two_vlans(talk: Talk) -> None:
    """As routed: the copy follows at once, or behind the next one."""
    sent: list[tuple[int, bytes, int, int]] = []
    for side, payload, flags in (
        (CLIENT, b"", SYN), (SERVER, b"", SYN | ACK), (CLIENT, CONNECT, ACK), (SERVER, CONFIRM, ACK),
        (CLIENT, dt(setup(0)), ACK), (SERVER, dt(granted(0)), ACK), (CLIENT, dt(read(1, dbw(1, 0))), ACK),
        (SERVER, dt(words(1, 1)), ACK), (CLIENT, b"", FIN | ACK), (SERVER, b"", FIN | ACK),
    ):  # fmt: skip
        talk.vlan = 10
        sent.append((side, payload, flags, talk.seq[side]))
        talk.packet(side, payload, flags)
        if not flags & SYN and len(sent) > 3:
            talk.vlan = 11
            for side_, payload_, flags_, seq in sent[:-1]:
                talk.packet(side_, payload_, flags_, seq=seq, after_ns=1)
            sent = sent[-1:]


def left_out_by_the_user(talk: Talk) -> None:
    talk.pipeline = Pipeline(talk, Options(strict=True, only=lambda one: one.number > 1))
    talk.open()
    polled(talk, 1)
    talk.packet(CLIENT, dt(read(9, dbw(1, 0))), seq=talk.seq[CLIENT] - 31)
    talk.lose(CLIENT, read(9, dbw(1, 0)))
    talk.connect()
    talk.ask(setup(0))
    talk.tell(granted(0))
    talk.close()


def another_protocol(talk: Talk) -> None:
    talk.ports[SERVER] = 80
    talk.hello()
    for _ in range(2):
        talk.packet(CLIENT, HTTP)
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(words(1, 1))
    talk.packet(CLIENT, flags=RST, seq=talk.seq[CLIENT] + 500)


SCENES: Final[list[Callable[[Talk], None]]] = [
    a_whole_session,
    the_server_speaks_first,
    met_in_its_midst,
    out_of_order,
    sent_again,
    with_a_gap,
    a_gap_that_only_acknowledgements_show,
    a_first_answer_that_is_lost,
    an_empty_packet_behind_what_is_lost,
    far_ahead,
    a_packet_that_the_capture_cut,
    keep_alives,
    keep_alives_of_an_open_connection,
    keep_alives_behind_a_handshake,
    opened_and_closed,
    refused_and_unanswered,
    a_syn_behind_its_answer,
    false_ends,
    a_true_end_with_a_wrong_number,
    octets_behind_a_reset,
    a_forged_syn,
    a_forged_syn_with_a_number_nearby,
    a_new_connection,
    a_new_connection_that_only_its_octets_show,
    the_same_that_the_answers_show,
    a_connect_request_far_away,
    two_vlans,
    two_vlans_from_the_midst_on,
    every_packet_in_two_vlans,
    left_out_by_the_user,
    another_protocol,
]


def captured(scene: Callable[[Talk], None], begins: tuple[int, int] = BEGINS) -> Placed:
    talk = Placed(begins)
    scene(talk)
    talk.pipeline.finish()
    return talk


@pytest.mark.parametrize("scene", SCENES, ids=lambda scene: scene.__name__)
def test_it_does_not_matter_where_numbers_wrap(scene: Callable[[Talk], None]) -> None:
    first = captured(scene)
    right = told(first)
    for side in (CLIENT, SERVER):
        for place in sorted(first.places[side]):
            begins = list(BEGINS)
            begins[side] = -place & MASK
            found = told(captured(scene, (begins[0], begins[1])))
            assert found == right, (side, place)
