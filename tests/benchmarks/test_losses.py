"""What is told of a capture from which packets are missing is told of the whole one, too; and what is untrue is counted."""

from __future__ import annotations

from itertools import chain
from pathlib import Path
from random import Random

import pytest

from benchmarks import losses
from benchmarks.blame import BLAMELESS, BLAMELESS_REASONS, BLAMES, NOT_ANSWERED, PREFIXES, REASONS, names_loss
from benchmarks.losses import Table, judge, kept, made, main
from benchmarks.told import Capture, Key, Packet, Pair, Statement, Told, Unanswered, read
from benchmarks.verdict import OPEN, RIGHT, WRONG, Truth, Verdict, blaming, compare
from dissect.engine.findings.catalogue import CATALOGUE
from dissect.engine.transactions.transaction import (
    CAPTURE_ENDED,
    CONNECTION_CLOSED,
    HOLE,
    LIKELY,
    REASON_TEXTS,
    REFERENCE_REUSED,
    SURE,
)

CAPTURES = Path(__file__).resolve().parents[2] / "captures"
PACKETS = 6000
SMALL = "nodes7-poll.pcapng"


NOTHING = Capture("planted")


class Planted(Told):
    """What is told of nothing, to be planted in."""

    def __init__(self, *pairs: Pair) -> None:
        super().__init__(NOTHING, [])
        self.pairs += pairs
        self.planted: list[Statement] = []

    @property
    def statements(self) -> list[Statement]:
        return self.planted


def pair(
    request: int, answer: int, reference: int = 1, certainty: str = SURE, octets: tuple[bytes, bytes] = (b"", b"")
) -> Pair:
    return Pair(Key("a:1", "b:102", reference, request), answer, certainty, octets)


def statement(slug: str, *packets: int, detail: str = "", ends: tuple[str, ...] = ("a:1", "b:102")) -> Statement:
    return Statement(slug, ends, packets[0], packets[-1], packets, detail)


def silent(request: int, reason: str, octets: bytes = b"", certainty: str = "", *, missed: bool = True) -> Unanswered:
    return Unanswered(Key("a:1", "b:102", 1, request), octets, reason, certainty, missed, "Read Var")


def judged(told: Pair, *whole: Pair) -> str:
    return Truth(Planted(*whole)).judge(told)


def blamed(said: Statement, *whole: Statement, pairs: tuple[Pair, ...] = ()) -> list[str]:
    """Return the slugs that are counted when this is said, and the complete capture says that."""
    truth, told = Planted(*pairs), Planted()
    truth.planted += whole
    told.planted.append(said)
    return list(compare(NOTHING, Truth(truth), told, []).blaming.elements())


def reasons(said: Unanswered, *whole: Unanswered, pairs: tuple[Pair, ...] = ()) -> list[str]:
    truth, told = Planted(*pairs), Planted()
    truth.unanswered += whole
    told.unanswered.append(said)
    return list(compare(NOTHING, Truth(truth), told, []).blaming.elements())


# ---- the whole engine ------------------------------------------------------------------------------------------------


def test_a_tenth_of_the_packets_is_missing_and_no_answer_is_given_to_another_request() -> None:
    capture = made(PACKETS, 1)
    truth = Truth(Told(capture, range(PACKETS)))
    assert len(truth.pairs) > PACKETS // 4
    for burst in (False, True):
        numbers = kept(PACKETS, 0.1, burst, Random(f"losses {burst}"))
        assert 0.85 * PACKETS < len(numbers) < 0.95 * PACKETS
        verdict = compare(capture, truth, Told(capture, numbers), numbers)
        assert verdict.counts[SURE, WRONG] == 0
        assert verdict.told > 0.7 * len(truth.pairs)
        assert verdict.stays > 0.97
        assert verdict.missed < 0.01 * len(truth.pairs)


def test_of_a_complete_capture_nothing_is_untrue() -> None:
    for capture in (made(2000, 2), read(CAPTURES / "crafted" / "coverage-functions.pcapng", "functions")):
        numbers = range(len(capture.packets))
        verdict = compare(capture, Truth(Told(capture, numbers)), Told(capture, numbers), numbers)
        assert verdict.told == verdict.counts[SURE, RIGHT] == verdict.stay == verdict.of_kept > 90
        assert not verdict.details
        assert (verdict.missed, verdict.excused, verdict.blaming.total()) == (0, 0, 0)


def test_packets_and_connections_keep_their_numbers_in_the_whole_capture() -> None:
    capture = made(PACKETS, 1)
    whole = Told(capture, range(PACKETS))
    part = Told(capture, range(PACKETS // 2, PACKETS))
    found = set(part.pairs) & set(whole.pairs)
    assert len(found) > 0.9 * len(part.pairs) > 500
    for told in (whole, part):
        assert all(one.first <= min(one.packets) <= max(one.packets) <= one.last for one in told.statements if one.ends)
    assert min(one.first for one in part.statements if one.ends) >= PACKETS // 2


def test_a_pair_that_is_planted_in_a_real_capture_is_wrong() -> None:
    capture = made(1000, 3)
    numbers = range(len(capture.packets))
    told = Told(capture, numbers)
    truth = Truth(Told(capture, numbers))
    by_connection: dict[tuple[str, str, int], list[int]] = {}
    for at, one in enumerate(told.pairs):
        by_connection.setdefault(one.request[:3], []).append(at)
    first, second = next(places for places in by_connection.values() if len(places) > 1)[:2]
    mine, other = told.pairs[first], told.pairs[second]
    told.pairs[first] = mine._replace(answer=other.answer, octets=(mine.octets[0], other.octets[1]))
    verdict = compare(capture, truth, told, numbers)
    assert verdict.counts[SURE, WRONG] == 1
    assert verdict.stay == verdict.of_kept - 1
    assert verdict.missed == 0
    (line,) = verdict.details
    assert line.startswith("made traffic: WRONG PAIR: ")
    assert f"request {mine.request.packet + 1}, answer {other.answer + 1}" in line


# ---- pairs -----------------------------------------------------------------------------------------------------------


def test_which_pairs_are_right() -> None:
    whole = (pair(0, 1), pair(2, 3), pair(4, 5, 2))
    assert judged(pair(0, 1), *whole) == RIGHT
    assert judged(pair(0, 3), *whole) == WRONG
    assert judged(pair(2, 1, certainty=LIKELY), *whole) == WRONG
    assert judged(pair(6, 7, octets=(b"asked", b"told")), *whole) == WRONG  # the complete capture has no such pair
    assert judged(pair(0, 1, 3), *whole) == WRONG


def test_a_pdu_that_was_sent_again_or_captured_in_part_is_the_same() -> None:
    long = (b"asked", bytes(range(200)))
    whole = (pair(0, 4, octets=long), pair(5, 9, octets=(b"other", b"told")))
    assert judged(pair(0, 2, octets=(b"asked", long[1][:90])), *whole) == RIGHT  # only its first fragments
    assert judged(pair(1, 4, octets=long), *whole) == RIGHT  # the request once more
    assert judged(pair(1, 3, octets=long), *whole) == RIGHT  # both once more
    assert judged(pair(0, 8, octets=(b"asked", b"told")), *whole) == WRONG
    assert judged(pair(1, 9, octets=(b"asked", b"told")), *whole) == WRONG


def test_answers_in_one_packet_are_told_apart_by_their_octets() -> None:
    whole = (pair(0, 1, octets=(b"one", b"1")), pair(0, 1, octets=(b"two", b"2")))
    assert judged(pair(0, 1, octets=(b"two", b"2")), *whole) == RIGHT
    assert judged(pair(0, 1, octets=(b"two", b"1")), *whole) == WRONG


def test_of_what_the_complete_capture_is_not_sure_nothing_is_wrong() -> None:
    whole = (pair(0, 1, certainty=LIKELY), pair(2, 3))
    assert judged(pair(0, 3), *whole) == OPEN
    assert judged(pair(2, 1), *whole) == OPEN
    assert judged(pair(2, 3), *whole) == RIGHT


def test_pairs_are_counted_by_certainty() -> None:
    whole = Truth(Planted(pair(0, 1), pair(2, 3), pair(4, 5), pair(6, 7), pair(8, 9), pair(10, 11)))
    told = Planted(pair(0, 1), pair(2, 3, certainty=LIKELY), pair(4, 7), pair(6, 5, certainty=LIKELY))
    verdict = compare(NOTHING, whole, told, range(11))
    assert dict(verdict.counts) == {
        (SURE, RIGHT): 1, (LIKELY, RIGHT): 1, (SURE, WRONG): 1, (LIKELY, WRONG): 1,
    }  # fmt: skip
    assert (verdict.kept, verdict.of_kept, verdict.stay, verdict.missed) == (11, 5, 1, 1)
    assert verdict.sure_wrong == 0.5
    assert verdict.stays == 0.2


# ---- statements ------------------------------------------------------------------------------------------------------


def test_every_finding_and_reason_blames_or_has_a_reason_not_to() -> None:
    slugs = [slug for slug in CATALOGUE if slug.startswith(PREFIXES)]
    assert len(slugs) > 50
    assert set(slugs) == BLAMES | set(BLAMELESS)
    assert not BLAMES & set(BLAMELESS)
    assert set(REASON_TEXTS) == REASONS | set(BLAMELESS_REASONS)
    assert not REASONS & set(BLAMELESS_REASONS)
    assert all(chain(BLAMELESS.values(), BLAMELESS_REASONS.values()))


def test_what_names_a_loss_does_not_blame() -> None:
    for said in (REASON_TEXTS[HOLE], "request not captured", "2 gaps since", "packets were lost while capturing"):
        assert names_loss(said)
        assert blamed(statement("session.too_many_jobs", 3, detail=said)) == []
    for said in ("more requests pending than the 1 granted (AmQ)", "Singapore", REASON_TEXTS[REFERENCE_REUSED]):
        assert not names_loss(said)
        assert blamed(statement("session.too_many_jobs", 3, detail=said)) == ["session.too_many_jobs"]


def test_a_finding_of_a_connection_is_true_when_the_complete_capture_says_it_of_that_connection() -> None:
    said = statement("session.cut", 10, 20)
    assert blamed(said) == ["session.cut"]
    assert blamed(said, statement("session.cut", 15, 90)) == []
    assert blamed(said, statement("session.cut", 21, 90)) == ["session.cut"]  # a later connection over the same ports
    assert blamed(said, statement("session.cut", 10, 20, ends=("a:2", "b:102"))) == ["session.cut"]
    assert blamed(said, statement("session.bad_grant", 10, 20)) == ["session.cut"]
    assert blamed(statement("transaction.orphan", 3)) == blamed(statement("stream.hole", 3)) == []
    assert blamed(said, statement("stream.conflict", 12)) == []  # two versions of some octets


def test_a_finding_of_a_request_is_true_when_the_complete_capture_says_it_of_that_request() -> None:
    said = statement("transaction.refused", 10, 11, detail="Read Var: refused")
    assert blamed(said, statement("transaction.refused", 10, 11, detail="another")) == []
    assert blamed(said, statement("transaction.refused", 8, 10, 30, detail="another")) == []
    assert blamed(said, statement("transaction.refused", 8, 9, 30, detail="another")) == ["transaction.refused"]


def test_findings_that_reach_over_connections() -> None:
    far = statement("security.new_writer", 90, 91, ends=("a:7", "b:102"))
    assert blamed(statement("security.new_writer", 3), far) == []
    assert blamed(statement("security.new_writer", 3, ends=("c:1", "b:102")), far) == ["security.new_writer"]
    odd = statement("s7.odd_address", 90, 91, ends=("x:7", "y:102"), detail="DB 0")
    assert blamed(statement("s7.odd_address", 3, detail="DB 0"), odd) == []
    assert blamed(statement("s7.odd_address", 3, detail="DB 9"), odd) == ["s7.odd_address"]
    assert blamed(statement("transaction.odd_data_code", 3, 4), pairs=(pair(3, 4),)) == []
    assert blamed(statement("transaction.odd_data_code", 3, 4), pairs=(pair(3, 5),)) == ["transaction.odd_data_code"]


def test_a_finding_that_is_true_may_still_say_that_there_was_no_answer() -> None:
    said = statement("security.plc_stop", 3, detail=f"a to b: PLC stop{NOT_ANSWERED}")
    whole = statement("security.plc_stop", 3, 4, detail="a to b: PLC stop, accepted")
    assert blamed(said, whole, pairs=(pair(3, 4),)) == [f"security.plc_stop{NOT_ANSWERED}"]
    assert blamed(said, said) == []
    assert blamed(said._replace(detail="a to b: PLC stop, answer not captured"), whole, pairs=(pair(3, 4),)) == []


def test_the_reason_of_a_request_without_answer_is_compared_request_by_request() -> None:
    closed = silent(3, CONNECTION_CLOSED)
    assert reasons(closed, pairs=(pair(3, 4),)) == [f"reason {CONNECTION_CLOSED}"]
    assert reasons(closed, closed) == []
    assert reasons(closed, silent(5, CONNECTION_CLOSED, b"another")) == [f"reason {CONNECTION_CLOSED}"]
    assert reasons(silent(3, REFERENCE_REUSED), closed) == [f"reason {REFERENCE_REUSED}"]
    assert reasons(silent(3, CAPTURE_ENDED), closed) == []  # the end of the connection is what was left out
    assert reasons(silent(3, CAPTURE_ENDED), pairs=(pair(3, 4),)) == [f"reason {CAPTURE_ENDED}"]
    # The request once more, of which the first copy was left out.
    assert reasons(silent(7, CONNECTION_CLOSED, b"octets"), silent(3, CONNECTION_CLOSED, b"octets")) == []
    conflict = Planted(pair(3, 4))
    conflict.planted.append(statement("stream.conflict", 1))  # two versions of some octets
    told = Planted()
    told.unanswered.append(closed)
    assert compare(NOTHING, Truth(conflict), told, []).blaming.total() == 0
    # Nothing is said of these: the answer was not captured, or it may still come.
    assert reasons(silent(3, HOLE), pairs=(pair(3, 4),)) == []
    assert reasons(silent(3, CAPTURE_ENDED, missed=False), pairs=(pair(3, 4),)) == []


def test_what_is_true_of_the_capture_up_to_its_last_packet_blames_nobody() -> None:
    """The answer to the last request comes after the last packet that is kept, more than a second later."""
    capture = read(CAPTURES / "answer-slow.pcapng", "slow")
    truth = Truth(Told(capture, range(len(capture.packets))))
    slow = max(truth.pairs, key=lambda one: one.answer - one.request.packet)
    numbers = range(slow.answer)
    told = Told(capture, numbers)
    told.unanswered.append(Unanswered(slow.request, slow.octets[0], CAPTURE_ENDED, "", True, "Read Var"))
    assert blaming(capture, truth, told, numbers) == []
    told.unanswered.append(Unanswered(slow.request, slow.octets[0], REFERENCE_REUSED, "", True, "Read Var"))
    assert [one.slug for one in blaming(capture, truth, told, numbers)] == [f"reason {REFERENCE_REUSED}"]
    (ended,) = blaming(capture, truth, told, [*numbers, slow.answer + 1])[:1]
    assert ended.slug == f"reason {CAPTURE_ENDED}"


def test_an_excuse_for_a_request_that_was_never_answered_is_counted() -> None:
    whole = Planted(pair(9, 10))
    whole.unanswered += [silent(3, CONNECTION_CLOSED), silent(5, HOLE)]
    told = Planted()
    told.unanswered += [
        silent(3, HOLE, certainty=SURE),
        silent(5, HOLE, certainty=SURE),
        silent(9, HOLE, certainty=SURE),
    ]
    assert compare(NOTHING, Truth(whole), told, []).excused == 1
    told.unanswered[0] = silent(3, HOLE, certainty=LIKELY)
    assert compare(NOTHING, Truth(whole), told, []).excused == 0


# ---- the command -----------------------------------------------------------------------------------------------------


def test_losses_are_as_many_as_asked_for() -> None:
    for burst in (False, True):
        numbers = kept(100_000, 0.3, burst, Random(3))
        assert 65_000 < len(numbers) < 75_000
        assert numbers == sorted(set(numbers))


def test_each_bar_is_named_when_it_is_missed() -> None:
    table = Table([0.02, 0.1], 1, 1)
    row, other = table.rows[0.02, False], table.rows[0.1, True]
    row.counts[SURE, RIGHT] = 9_997
    row.counts[SURE, WRONG] = 3
    row.of_kept, row.stay = 10_000, 9_700
    other.of_kept, other.stay = 10_000, 0  # asked of 2 % only
    other.blaming["session.cut"] = 5
    assert judge([table]) == []
    row.stay -= 1
    assert judge([table]) == ["only 96.99% of the pairs stay sure where 2% are lost"]
    other.counts[SURE, WRONG] = 1
    other.blaming["session.bad_grant"] = 1
    assert judge([table])[:2] == ["6 statements blame untruly, 5 may", "4.0 of 10,000 sure pairs are wrong"]


def test_statements_are_counted_for_each_folder() -> None:
    tables = [Table([0.1], 1, 1), Table([0.1], 1, 1, 12)]
    for table, count in zip(tables, (5, 12), strict=True):
        table.rows[0.1, False].blaming["session.cut"] = count
    assert judge(tables) == []
    tables[1].rows[0.1, True].blaming["session.cut"] = 1
    assert judge(tables) == ["13 statements blame untruly, 12 may"]


def test_the_command_prints_a_row_for_each_rate(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "deeper").mkdir()
    (tmp_path / "deeper" / SMALL).write_bytes((CAPTURES / SMALL).read_bytes())
    (tmp_path / "broken.pcap").write_text("no capture")
    assert main([str(tmp_path), "--packets", "500", "--rates", "0.1", "--rounds", "1"]) in {0, 1}
    out, err = capsys.readouterr()
    lines = out.splitlines()
    assert "made traffic: 1 captures, 500 packets" in lines[0]
    assert [line.split()[:2] for line in lines[2:4]] == [["10%", "single"], ["10%", "bursts"]]
    assert lines[5].startswith(f"captures in {tmp_path.parent.name}/{tmp_path.name}: 1 captures, ")
    assert "broken.pcap: not a capture file" in err


def test_the_command_says_what_is_untrue(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(losses, "compare", planted)
    assert main([str(tmp_path), "--packets", "100", "--rates", "0.1", "--rounds", "3", "--details"]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert "session.cut             6" in lines
    assert "made traffic             6" in lines
    assert lines.count("10% bursts: made traffic: session.cut: ends") == 3
    assert lines[-1] == "MISSED: 6 statements blame untruly, 5 may"
    assert main([str(tmp_path), "--packets", "100", "--rates", "0.1", "--rounds", "2"]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == "All bars are held."


def planted(capture: Capture, truth: Truth, told: Told, numbers: list[int]) -> Verdict:
    verdict = Verdict()
    verdict.blaming["session.cut"] += 1
    verdict.where[capture.name] += 1
    verdict.details.append(f"{capture.name}: session.cut: ends")
    return verdict


def test_a_rate_is_a_share(capsys: pytest.CaptureFixture[str]) -> None:
    for rate in ("0", "1", "2", "-0.1"):
        with pytest.raises(SystemExit):
            main(["--rates", rate])
        assert "more than 0 and less than 1" in capsys.readouterr().err


def test_a_capture_of_any_link_type_is_read_with_its_keys() -> None:
    capture = read(CAPTURES / "crafted" / "link-types.pcapng", "links")
    assert len({packet.link_type for packet in capture.packets}) > 3
    cut = Capture("cut")
    cut.frame(5, b"0123456789", 2, 6, 60, 1)
    cut.secrets(b"keys")
    assert cut.packets == [Packet(5, b"2345", 60, 1)]
    assert cut.keys == [(1, b"keys")]
