"""The comparison: every TPDU and S7 PDU of a capture, our reading and Wireshark's, field by field.

Both sides are matched packet by packet in the order of the stream. A record that the other side shows in a different packet is
matched afterwards by its octets. A record that only one side shows is one difference.
"""

from __future__ import annotations

from collections import Counter
from difflib import SequenceMatcher
from typing import Final

from dissect.protocols.tls.key_log import KeyLog
from dissect.testing.oracle import facts, grounds
from dissect.testing.oracle.facts import FieldPlace, LocatedValue, Record, Value
from dissect.testing.oracle.grounds import Case, Evidence
from dissect.testing.oracle.known import explain
from dissect.testing.oracle.ours import Witness, take_joined
from dissect.testing.oracle.plus import PlusProof
from dissect.testing.oracle.theirs import Frame
from dissect.testing.oracle.tshark import OracleError, Reader, read_tshark

_GAVE_UP: Final = "Wireshark stopped where the capture is damaged"
_WHOLE: Final = FieldPlace("", 0, grounds.WHOLE)
_FRAME: Final = FieldPlace("", 0, grounds.FRAME)
_OCTETS: Final = FieldPlace("", 0, grounds.OCTETS)


class FieldDifference:
    """One disagreement between the two sides.

    ``field`` is its name; ``ours`` and ``theirs`` are None if a side does not have it. ``known`` is the id of the entry of
    `dissect.testing.oracle.known` that explains it, empty if none does.
    """

    __slots__ = ("field", "frame", "kind", "known", "ours", "theirs")

    def __init__(self, kind: str, frame: int, field: str, ours: Value | None, theirs: Value | None, known: str) -> None:
        self.kind = kind
        self.frame = frame
        self.field = field
        self.ours = ours
        self.theirs = theirs
        self.known = known

    def __repr__(self) -> str:
        return f"<{self}>"

    def __str__(self) -> str:
        sides = f"ours {_shown(self.ours)}, theirs {_shown(self.theirs)}"
        return f"frame {self.frame} {self.kind} {self.field}: {sides} ({self.known or 'unexplained'})"


def _shown(value: Value | None) -> str:
    if value is None:
        return "nothing"
    return value.hex() or "empty" if isinstance(value, bytes) else f"{value} (0x{value:02x})"


class Comparison:
    """The result: how many TPDUs, PDUs and fields both sides have, and every difference.

    ``other`` counts the fields that Wireshark shows in bodies under names that no layout of ours has, ``again`` those of them
    whose octets are in a compared field. ``not_comparable`` counts the PDUs that Wireshark cannot dissect, by reason. ``loss``
    describes the part of the capture that could not be read and was not compared, empty for none. ``plus`` are the
    self-consistency checks of S7comm-plus PDUs.
    """

    def __init__(self) -> None:
        self.compared: Counter[str] = Counter()
        self.fields = 0
        self.other: Counter[str] = Counter()
        self.again: Counter[str] = Counter()
        self.differences: list[FieldDifference] = []
        self.not_comparable: Counter[str] = Counter()
        self.loss = ""
        self.plus = PlusProof()

    @property
    def unexplained(self) -> list[FieldDifference]:
        """The differences without an explanation: bugs, ours or theirs, that no one has examined."""
        return [difference for difference in self.differences if not difference.known]

    @property
    def known(self) -> Counter[str]:
        """Counts of the explained differences, by explanation."""
        return Counter(difference.known for difference in self.differences if difference.known)


class _Bench:
    """Pairs records, compares the pairs, and keeps records without a partner."""

    def __init__(self, path: str, witness: Witness) -> None:
        self.result = Comparison()
        self.result.not_comparable += witness.not_comparable
        self.result.loss = witness.loss
        self.result.plus = witness.plus
        self._evidence = Evidence(path, witness.messages)
        self._lonely: dict[str, tuple[list[Record], list[tuple[Record, Frame]]]] = {
            facts.TPDU: ([], []),
            facts.PDU: ([], []),
        }

    def packet(self, kind: str, ours: list[Record], theirs: list[Record], frame: Frame | None) -> None:
        """Compare what both sides found in one packet."""
        matcher = SequenceMatcher(None, [one.octets for one in ours], [one.octets for one in theirs], autojunk=False)
        for tag, a, after_a, b, after_b in matcher.get_opcodes():
            alike = [_alike(mine, other) for mine, other in zip(ours[a:after_a], theirs[b:after_b], strict=False)]
            for index in range(max(after_a - a, after_b - b)):
                if tag == "equal" or (after_a - a == after_b - b and alike[index]):
                    assert frame is not None
                    self._compare(ours[a + index], theirs[b + index], frame)
                    continue
                if index < after_a - a:
                    self._lonely[kind][0].append(ours[a + index])
                if index < after_b - b:
                    assert frame is not None
                    self._lonely[kind][1].append((theirs[b + index], frame))

    def finish(self) -> Comparison:
        """Match records across packets, and report those that only one side has."""
        for ours, theirs in self._lonely.values():
            self._match(ours, theirs, True)
            self._match(ours, theirs, False)
            self.result.differences += [self._alone(record, None, None) for record in ours]
            self.result.differences += [self._alone(None, record, frame) for record, frame in theirs]
        self.result.differences.sort(key=lambda difference: (difference.frame, difference.kind, difference.field))
        return self.result

    def _match(self, ours: list[Record], theirs: list[tuple[Record, Frame]], explained: bool) -> None:
        """Match records of one connection whose octets both sides show, but in different packets.

        The headers of many TPDUs are equal. So the first round only accepts pairs whose different packets are ``explained``;
        the second round pairs the rest, unless each of the two has its own explanation.
        """
        for record in list(ours):
            for partner, frame in theirs:
                if partner.octets != record.octets or not self._evidence.of_one_flow(record.frame, partner.frame):
                    continue
                apart = self._difference(_FRAME, record.frame, partner.frame, record, partner, frame)
                if explained and not apart.known:
                    continue
                if not explained and self._alone(record, None, None).known and self._alone(None, partner, frame).known:
                    continue
                ours.remove(record)
                theirs.remove((partner, frame))
                self.result.differences.append(apart)
                self._compare(record, partner, frame)
                break

    def _alone(self, ours: Record | None, theirs: Record | None, frame: Frame | None) -> FieldDifference:
        """Return the difference for a record that only one side has."""
        mine, other = (record.octets if record is not None else None for record in (ours, theirs))
        return self._difference(_WHOLE, mine, other, ours, theirs, frame)

    def _compare(self, ours: Record, theirs: Record, frame: Frame) -> None:
        self.result.compared[ours.kind] += 1
        self.result.other += theirs.other
        self.result.again += theirs.again
        if ours.octets != theirs.octets:
            self.result.differences.append(self._difference(_OCTETS, ours.octets, theirs.octets, ours, theirs, frame))
        if theirs.joined:
            take_joined(ours, theirs.joined)
        for place in sorted(ours.facts.keys() | theirs.facts.keys()):
            mine: LocatedValue | None = ours.facts.get(place)
            other: LocatedValue | None = theirs.facts.get(place)
            if mine is not None and other is not None:
                self.result.fields += 1
                if mine.offset != other.offset:
                    where = FieldPlace(place.part, place.number, f"position of {place.name}")
                    self.result.differences.append(
                        self._difference(where, mine.offset, other.offset, ours, theirs, frame)
                    )
            if mine is None or other is None or not _same(mine.value, other.value):
                values = mine.value if mine is not None else None, other.value if other is not None else None
                self.result.differences.append(self._difference(place, *values, ours, theirs, frame))

    def _difference(
        self,
        place: FieldPlace,
        mine: Value | None,
        other: Value | None,
        ours: Record | None,
        theirs: Record | None,
        frame: Frame | None,
    ) -> FieldDifference:
        record = ours if ours is not None else theirs
        assert record is not None
        explanation = explain(Case(place, mine, other, ours, theirs, frame, self._evidence))
        return FieldDifference(record.kind, record.frame, str(place), mine, other, explanation)


def _same(ours: Value, theirs: Value) -> bool:
    """Return whether two values are equal; one side may split octets into bits that the other shows as one number."""
    if isinstance(ours, bytes) != isinstance(theirs, bytes):
        ours, theirs = (int.from_bytes(one, "big") if isinstance(one, bytes) else one for one in (ours, theirs))
    return ours == theirs


def _alike(ours: Record, theirs: Record) -> bool:
    """Return whether two records with different octets may be the same: TPDUs by their TPKT header, PDUs by their size."""
    if ours.kind == facts.TPDU:
        return ours.octets[: facts.TPKT_SIZE] == theirs.octets[: facts.TPKT_SIZE]
    return len(ours.octets) == len(theirs.octets)


def compare(path: str, read: Reader = read_tshark, reorder: bool = False, tls_keys: KeyLog | None = None) -> Comparison:
    """Compare both dissections of a capture file; ``read`` runs Wireshark (`read_tshark` or `read_pyshark`).

    ``reorder`` is Wireshark's preference to put TCP segments in order before it dissects them. ``tls_keys`` decrypt TLS on our
    side; its contents are not compared. Raises OracleError if Wireshark cannot be run and CaptureError if the file cannot be
    read. In a damaged capture, Wireshark may stop earlier or later than we do: only the part before that is compared.
    """
    witness = Witness(path, tls_keys)
    bench = _Bench(path, witness)
    waiting: dict[str, dict[int, list[int]]] = {kind: {} for kind in witness.messages}
    for kind, records in witness.messages.items():
        for number, (frame_number, _) in enumerate(records):
            waiting[kind].setdefault(frame_number, []).append(number)
    last = 0
    gave_up = False
    try:
        for frame in read(path, witness.ports, reorder):
            last = frame.number
            for kind, numbers in waiting.items():
                ours = witness.records(kind, numbers.pop(frame.number, []))
                bench.packet(kind, ours, frame.tpdus if kind == facts.TPDU else frame.pdus, frame)
    except OracleError:
        if not witness.loss or not last:
            raise
        gave_up = True
    for kind, numbers in waiting.items():
        for number, left in numbers.items():
            if gave_up and number > last:
                bench.result.not_comparable[_GAVE_UP] += len(left)
            else:
                bench.packet(kind, witness.records(kind, left), [], None)
    return bench.finish()
