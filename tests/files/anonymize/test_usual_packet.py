"""Usual packets, made anew in few steps: the same octets and the same account as by the way of all others."""

from __future__ import annotations

from pathlib import Path
from random import Random

from dissect.engine.pipeline import Options
from dissect.files.anonymize.account import Account, Choices
from dissect.files.anonymize.addresses import AddressMap
from dissect.files.anonymize.checksum import ONES, total
from dissect.files.anonymize.fragments import Fragment
from dissect.files.anonymize.packet import Packets
from dissect.files.anonymize.plus import PlusRules
from dissect.files.anonymize.plus_contents import PlusContents
from dissect.files.anonymize.rules import Rules
from dissect.files.anonymize.survey import Survey
from dissect.files.session import Run
from dissect.packets.source.files import open_capture
from dissect.packets.tcp import ip, link
from tests.cases import each
from tests.files.anonymize.support import KEY
from tests.meaning.report.support import ROOT
from tests.packets.source.craft import drain


class Way:
    """What makes packets anew, with or without the short way."""

    def __init__(self, path: Path, choices: Choices, short: bool) -> None:
        self.account = Account()
        addresses = AddressMap(KEY)
        plus = PlusRules(PlusContents(KEY, choices, self.account), self.account)
        survey = Survey(KEY, Rules(KEY, addresses, choices), plus, self.account)
        run = Run([str(path)], survey, Options(strict=True))
        while run.step():
            pass
        survey.settle()
        self.packets = Packets(survey, addresses, choices, self.account)
        self.short = short
        self.taken = 0

    def renew(self, frame: int, octets: bytes, link_type: int) -> bytes | Fragment | None:
        """Take a packet by the short way where that is open."""
        made = self.packets.usual.renew(frame, octets, link_type) if self.short else None
        self.taken += made is not None
        return made if made is not None else self.packets.renew(frame, octets, link_type)


def damaged(octets: bytes, dice: Random) -> bytes:
    """Return a frame that may be cut, have one other octet in its headers, or some behind it."""
    new = bytearray(octets)
    if dice.random() < 0.5:
        new[dice.randrange(min(len(new), 60))] = dice.randrange(256)
    return bytes(new[: dice.randrange(1, len(new))] if dice.random() < 0.2 else new) + bytes(b"\1" * dice.randrange(3))


def right(octets: bytes, link_type: int) -> bytes:
    """Return a packet whose TCP checksum is right, as it is on the wire, and which is not left to a network card."""
    at = int(link.find_ip(octets, 0, len(octets), link_type)[0])
    if at < 0 or len(octets) < at + 40 or octets[at] != 0x45 or octets[at + 9] != ip.TCP:
        return octets
    start, stop = at + 20, at + int.from_bytes(octets[at + 2 : at + 4], "big")
    pseudo = octets[at + 12 : start] + bytes((0, ip.TCP)) + (stop - start).to_bytes(2, "big")
    value = ONES - total(pseudo + octets[start : start + 16] + bytes(2) + octets[start + 18 : stop]) or ONES
    return octets[: start + 16] + value.to_bytes(2, "big") + octets[start + 18 :]


@each("others", (False, True))
def test_both_ways_say_the_same(others: bool) -> None:
    dice = Random(7)
    taken = seen = 0
    for path in sorted((ROOT / "captures").glob("*.pcapng")):
        choices = Choices(keep_others=others)
        short, long = Way(path, choices, True), Way(path, choices, False)
        for number, frame in enumerate(drain(open_capture(str(path))).frames[:300], 1):
            whole = right(bytes(frame.octets), frame.link_type)
            for octets in (bytes(frame.octets), whole, damaged(whole, dice)):
                made, other = [way.renew(number, octets, frame.link_type) for way in (short, long)]
                seen += 1
                if isinstance(made, bytes) or isinstance(other, bytes):
                    assert made == other
        assert short.account.as_dict() == long.account.as_dict()
        assert not long.taken
        taken += short.taken
    assert seen > taken > seen / 4
