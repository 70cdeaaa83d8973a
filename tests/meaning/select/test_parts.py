"""A part of a capture that is cut out, or let through by a sieve, says of what is in it what the whole says."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Final

import pytest

from dissect.engine.observer import Observer
from dissect.engine.pipeline import Options, Pipeline
from dissect.engine.transactions.payloads import ScdMessage
from dissect.engine.transactions.side import Side
from dissect.engine.transactions.transaction import Transaction
from dissect.files.session import Run
from dissect.meaning.bindings import load_carrier
from dissect.meaning.select import Where
from dissect.meaning.select.columns import FieldsWriter
from dissect.meaning.select.selection import Selection, Wanted
from dissect.meaning.select.sieve import Sieve
from dissect.meaning.select.things import Context
from dissect.packets.source.files import open_capture
from dissect.packets.source.packet import PacketSink
from tests.meaning.select.support import CAPTURES

#: All transports: ISO-on-TCP, IBH-NetLink, S7comm-plus in frames, IP fragments, VLANs, slivers, retransmissions.
PARTS: Final = (
    "item-errors", "slivers", "two-clients", "crafted/netlink", "crafted/plus-plant", "crafted/ip-fragments", "crafted/vlan",
    "crafted/retransmissions", "crafted/sequence-wrap", "crafted/ipv6", "crafted/segments",
)  # fmt: skip


class Frames(PacketSink):
    """Keeps the packets of a file."""

    def __init__(self, path: Path) -> None:
        self.packets: list[tuple[int, bytes, int, int]] = []
        reader = open_capture(str(path))
        while reader.step(self):
            pass
        reader.close()

    def frame(self, time_ns: int, buf: bytes, start: int, end: int, wire_length: int, link_type: int) -> None:
        self.packets.append((int(time_ns), bytes(buf[start:end]), int(wire_length), int(link_type)))

    def through(self, observer: Observer, numbers: set[int] | None = None) -> None:
        """Read them all, or those with these numbers."""
        pipeline = Pipeline(observer, Options(strict=True))
        for number, (time_ns, octets, size, link) in enumerate(self.packets, 1):
            if numbers is None or number in numbers:
                pipeline.frame(time_ns, octets, 0, len(octets), size, link)
        pipeline.finish()


class Told(Observer):
    """Keeps transactions."""

    def __init__(self) -> None:
        super().__init__()
        self.transactions: list[Transaction] = []

    def transaction(self, transaction: Transaction) -> None:
        self.transactions.append(transaction)


def said(one: Transaction) -> tuple[object, ...]:
    return (
        one.function_name, one.outcome, one.pdu_ref, int(one.request_ns), int(one.response_ns), one.request_octets,
        one.response_octets,
    )  # fmt: skip


@pytest.mark.parametrize("name", PARTS)
def test_a_transaction_that_is_cut_out_is_the_same(name: str) -> None:
    frames = Frames(CAPTURES / f"{name}.pcapng")
    whole = Told()
    frames.through(whole)
    compared = 0
    for one in whole.transactions[:: max(1, len(whole.transactions) // 6)]:
        if one.outcome != "answered" or one.connection.udp:
            continue
        taken: dict[bool, set[int]] = {}
        for context in (False, True):
            selection = Selection(Wanted(transactions=[int(one.number)]), context=context)
            frames.through(selection)
            choice = selection.choice(0, 2**63 - 1)
            taken[context] = {
                number
                for number, (time_ns, octets, _, link) in enumerate(frames.packets, 1)
                if choice.takes(number, time_ns, octets, 0, len(octets), link)
            }
            assert (selection.uncertain, selection.missing) == (0, "")
        part = Told()
        frames.through(part, taken[True])
        assert said(one) in [said(other) for other in part.transactions], one.number
        assert {*map(int, one.frames)} <= taken[False] <= taken[True]
        assert len(taken[True]) < len(frames.packets)
        compared += 1
    assert compared


class Messages(Observer):
    """Counts what comes, by kind."""

    def __init__(self) -> None:
        super().__init__()
        self.wants_pdus = self.wants_tpdus = True
        self.seen: Counter[str] = Counter()
        self.frames: list[int] = []

    def pdu(self, frame: int, time_ns: int, side: Side, octets: bytes, cut: bool) -> None:
        self._count("pdu", frame)

    def plus_pdu(self, frame: int, time_ns: int, side: Side, octets: bytes, cut: bool) -> None:
        self._count("plus_pdu", frame)

    def scd(self, frame: int, time_ns: int, side: Side, found: ScdMessage) -> None:
        self._count("scd", frame)

    def tpdu(self, frame: int, time_ns: int, side: Side, octets: bytes) -> None:
        self.seen["tpdu"] += 1

    def ibh_packet(self, frame: int, time_ns: int, side: Side, octets: bytes) -> None:
        self.seen["ibh"] += 1

    def comment(self, frame: int, text: str) -> None:
        self.seen["comment"] += 1

    def _count(self, kind: str, frame: int) -> None:
        self.seen[kind] += 1
        self.frames.append(int(frame))


def messages(name: str, expression: str = "") -> tuple[Messages, Sieve | None]:
    seen = Messages()
    where = Where(expression) if expression else None
    sieve = Sieve(seen, where) if where is not None else None
    decoder = (
        load_carrier(CAPTURES / "scd" / "plant.toml", CAPTURES / "scd" / "plant.bind.toml") if "scd" in name else None
    )
    run = Run([CAPTURES / f"{name}.pcapng"], sieve or seen, Options(decoder=decoder))
    while run.step():
        pass
    return seen, sieve


@pytest.mark.parametrize(
    ("name", "kind"),
    [("item-errors", "pdu"), ("crafted/plus-plant", "plus_pdu"), ("scd/plant", "scd"), ("crafted/netlink", "pdu")],
)
def test_a_sieve_lets_messages_through_by_their_own_fields(name: str, kind: str) -> None:
    """Below and above a packet are all of them; headers of TPDUs and packets of IBH-NetLink always come."""
    whole, _ = messages(name)
    assert whole.seen[kind] > 2
    middle = sorted(whole.frames)[len(whole.frames) // 2]
    below, sieve = messages(name, f"frame < {middle}")
    rest, other = messages(name, f"frame >= {middle}")
    assert sorted(below.frames) == [frame for frame in sorted(whole.frames) if frame < middle]
    assert sorted(below.frames + rest.frames) == sorted(whole.frames)
    assert below.seen["tpdu"] == rest.seen["tpdu"] == whole.seen["tpdu"]
    assert below.seen["ibh"] == rest.seen["ibh"] == whole.seen["ibh"]
    assert below.seen["comment"] == whole.seen["comment"]
    assert sieve is not None
    assert other is not None
    assert (sieve.messages, other.messages) == (len(below.frames), len(rest.frames))
    assert not sieve.nothing
    none, nothing = messages(name, "host == 192.0.2.1")
    assert nothing is not None
    assert nothing.nothing
    assert none.frames == []


def test_columns_of_messages() -> None:
    """A line for each PDU of either protocol, TPDU and packet of IBH-NetLink: its packet, who sent it, its protocol."""
    for name, kinds in (
        ("item-errors", {"s7comm", "cotp"}),
        ("crafted/plus-plant", {"s7comm_plus", "cotp"}),
        ("crafted/netlink", {"s7comm", "netlink"}),
    ):
        writer = FieldsWriter()
        writer.wants_pdus = writer.wants_tpdus = True
        writer.write_fields(["protocol", "frame", "connection"], Context())
        run = Run([CAPTURES / f"{name}.pcapng"], writer)
        while run.step():
            pass
        lines = [str(line).split("\t") for line in writer.take()]
        assert {line[0] for line in lines} >= kinds, {line[0] for line in lines}
        seen = Counter(line[0] for line in lines if line[1].isdigit())
        assert {kind: seen[kind] > 1 for kind in kinds} == dict.fromkeys(kinds, True)


@pytest.mark.parametrize("count", [2, 3, 5])
def test_all_of_several_conditions_or_any_of_them(count: int) -> None:
    whole, _ = messages("item-errors")
    last = max(whole.frames)
    each_of = [f"frame > {number}" for number in range(count)]
    for at in range(count):
        conditions = [*each_of[:at], f"frame == {last}", *each_of[at + 1 :]]
        assert messages("item-errors", " and ".join(conditions))[0].frames == [last] * whole.frames.count(last)
        others = [f"frame == {number + 1000}" for number in range(count)]
        others[at] = f"frame == {last}"
        assert messages("item-errors", " or ".join(others))[0].frames == [last] * whole.frames.count(last)
