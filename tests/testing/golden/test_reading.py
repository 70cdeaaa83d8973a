from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.testing.golden import golden_text, read_session
from dissect.testing.golden.model import GoldenError, Link, Session
from dissect.testing.golden.reading import content_order, is_golden
from dissect.testing.golden.writing import link_lines
from dissect.wire.build import COMPILED
from tests.cases import each
from tests.meaning.report.support import OWN, ROOT, begun, saved
from tests.properties.packets import Flow, Packet, Segment, captured
from tests.testing.golden.support import WRITTEN, reads, session


def merged(one: list[Segment], other: list[Segment], turns: list[bool]) -> list[Packet]:
    """Return the packets of two connections, each in its order, mixed as ``turns`` says."""
    left, right = list(one), list(other)
    mixed = [(left if turn and left else right or left).pop(0) for turn in turns[: len(one) + len(other)]]
    return captured([*mixed, *left, *right])


@given(st.lists(st.booleans(), max_size=50), st.booleans(), st.booleans())
def test_interleaving_addresses_and_ports_do_not_matter(turns: list[bool], swapped: bool, alike: bool) -> None:
    flows = [Flow("10.0.0.1", "10.0.0.2", (40001, 102)), Flow("10.9.9.9", "10.0.0.2", (50001, 102))]
    if swapped:
        flows.reverse()
    one = reads(0, 2, 4, flow=flows[0]).reset(1).segments
    other = reads(*((0, 2, 4) if alike else (6, 8)), flow=flows[1]).reset(0).segments
    expected = golden_text(session(captured([*one, *other])))
    assert golden_text(session(merged(one, other, turns))) == expected
    assert golden_text(session(merged(other, one, turns))) == expected


def test_transactions_stand_in_the_order_of_their_requests() -> None:
    talk = begun()
    jobs = reads(0, 2).segments[7:]
    for index in (0, 2, 3, 1):  # both asked, answered the other way round
        talk.segments.append(jobs[index])
    said = [item.label for each in session(captured(talk.segments)).transactions for item in each.items]
    assert said == ["DB10.DBW0", "DB10.DBW2"]


@given(st.lists(st.tuples(st.integers(0, 4), st.integers(0, 3), st.booleans()), max_size=8))
def test_connections_stand_in_the_order_of_their_whole_text(shapes: list[tuple[int, int, bool]]) -> None:
    """They are compared line by line, as far as they are the same; one may say all that another does, and go on."""
    said = session(captured(reads(0, 2, 4, 0, 2).segments)).transactions
    links = []
    for count, skipped, named in shapes:
        link = Link()
        link.protocol = "s7comm" if named else ""
        link.addresses = (f"10.0.0.{count}", f"10.0.0.{skipped}")
        link.transactions = said[skipped : skipped + count]
        links.append(link)
    by_text = sorted(links, key=lambda link: ("\n".join(link_lines(link)), link.addresses))
    assert content_order(links) == by_text


def test_the_same_octets_under_every_hash_seed(capture: object) -> None:
    names = ["two-clients", "setup-pdu-sizes", "nodes7-poll-parallel"]
    code = (
        "import sys; from dissect.testing.golden import *; "
        "[sys.stdout.write(golden_text(read_session(path))) for path in sys.argv[1:]]; "
        "[print(each.text) for each in diff_sessions(read_session(sys.argv[1]), read_session(sys.argv[2]))]"
    )
    paths = [str(ROOT / "captures" / f"{name}.pcapng") for name in names]
    told = {
        subprocess.run(
            [sys.executable, "-c", code, *paths],
            env={**os.environ, "PYTHONHASHSEED": seed, "TZ": zone, "PYTHONIOENCODING": "utf-8"},
            capture_output=True,
            check=True,
        ).stdout
        for seed, zone in (("0", "UTC"), ("1", "Asia/Tokyo"), ("2", "America/Lima"))
    }
    assert len(told) == 1
    assert len(told.pop()) > 5000


def test_only_the_content_says_what_a_file_is(tmp_path: Path) -> None:
    golden = tmp_path / "golden.pcapng"
    golden.write_text(WRITTEN, encoding="utf-8")
    packets = saved(tmp_path / "capture.s7.txt", reads(0).packets())
    assert is_golden(golden)
    assert not is_golden(packets)
    assert not is_golden(tmp_path / "missing")
    assert len(read_session(golden).transactions) == 5
    assert len(read_session(packets).transactions) == 2


def test_damage_is_told(tmp_path: Path) -> None:
    path = saved(tmp_path / "cut.pcapng", reads(0, 2).packets())
    path.write_bytes(path.read_bytes()[:-7])
    assert "cut.pcapng" in read_session(path).damage[0]


def test_a_golden_that_cannot_be_read_says_why(tmp_path: Path) -> None:
    path = tmp_path / "bad.s7.txt"
    path.write_bytes(b"s7dissect golden 1\n\xff")
    with pytest.raises(GoldenError, match="byte 19 is not UTF-8"):
        read_session(path)


@pytest.mark.skipif(COMPILED, reason="compiled constants cannot be changed")
def test_a_session_has_a_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dissect.testing.golden.model.MAX_TRANSACTIONS", 3)
    with pytest.raises(GoldenError, match="more than 3 transactions; cut it first"):
        session(reads(0, 2, 4).packets())
    monkeypatch.setattr("dissect.testing.golden.model.MAX_TRANSACTIONS", 100)
    monkeypatch.setattr("dissect.testing.golden.model.MAX_OCTETS", 60)
    with pytest.raises(GoldenError, match="distinct messages"):
        session(reads(0, 2, 4).packets())


@pytest.mark.skipif(COMPILED, reason="compiled constants cannot be changed")
def test_a_capture_that_is_too_long_is_told_not_shortened(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dissect.testing.golden.model.MAX_TRANSACTIONS", 3)
    with pytest.raises(GoldenError, match="more than 3 transactions; cut it first"):
        read_session(ROOT / "captures" / "item-errors.pcapng")


def test_what_repeats_is_kept_once() -> None:
    polled = session(reads(*[0, 2] * 20).packets())
    assert len(polled.transactions) == 41
    assert len({id(each.exchange) for each in polled.transactions}) == 3


def test_the_model_has_values_as_python_knows_them() -> None:
    found: Session = session(reads(258).packets())
    transaction = found.transactions[1]
    (item,) = transaction.items
    assert (transaction.asked_by, transaction.outcome, transaction.function) == ("client", "answered", 4)
    assert (item.address, item.value, item.data, item.return_code, item.refused) == (
        "DB10.DBW258",
        258,
        b"\x01\x02",
        255,
        False,
    )
    assert transaction.latency_ns == 1_000_000
    assert transaction.pdu_ref == 1
    assert transaction.connection is found.links[0]
    assert found.links[0].addresses == ("10.0.0.1:49152", "10.0.0.2:102")


@each("path", [path for path in OWN if path.suffix != ".zst"])
def test_nothing_of_one_recording_is_in_a_golden(path: Path) -> None:
    found = read_session(path)
    text = golden_text(found)
    for link in found.links:
        for address in link.addresses:
            assert not address or address not in text
