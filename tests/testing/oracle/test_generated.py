"""The oracle over conversations made up at random: every field of every message agrees, or is known to differ.

`S7DISSECT_EXAMPLES` says how many conversations (a release wants 10,000).
"""

from __future__ import annotations

import os
from pathlib import Path
from random import Random
from typing import Final

import pytest

from dissect.testing.oracle.compare import compare
from dissect.testing.oracle.facts import PDU
from tests.testing.oracle.traffic import conversation, disordered, interleaved, sent_again, write_capture

CONVERSATIONS: Final = int(os.environ.get("S7DISSECT_EXAMPLES", "300"))
AT_ONCE: Final = 100

#: What generated traffic may differ in: nothing that begins in TCP but what stands here.
EXPECTED: Final = {
    "length-in-octets",
    "kept-from-before",
    "userdata-type-of-four-bits",
    "rejection-refused",
    "shown-again",
    "fill-of-an-item",
    "payload-as-octets",
    "last-part-alone",
    "time-with-its-century",
    "count-with-its-reserved-octet",
    "name-and-its-fields",
    "block-with-its-header",
    "mode-transition-as-head",
    "shown-at-the-gap",
}

#: What begins in TCP where something is missing, or sent again.
BESIDE_GAPS: Final = {
    "lost-by-tcp",
    "header-without-tpdu",
    "header-inside-a-message",
    "shown-before-the-gap-closed",
    "shown-where-sent-again",
    "unfinished",
}


@pytest.mark.parametrize("seed", range(-(-CONVERSATIONS // AT_ONCE)))
def test_conversations(tmp_path: Path, seed: int) -> None:
    rng = Random(seed)
    count = min(AT_ONCE, CONVERSATIONS - seed * AT_ONCE)
    packets = interleaved(rng, [conversation(rng, number) for number in range(count)])
    comparison = compare(str(write_capture(tmp_path / "made.pcap", packets)))
    assert comparison.unexplained == []
    assert set(comparison.known) <= EXPECTED
    assert comparison.compared[PDU] > 10 * count


@pytest.mark.parametrize("seed", range(1, 3))
def test_disordered_conversations(tmp_path: Path, seed: int) -> None:
    rng = Random(-seed)
    packets = interleaved(rng, [disordered(rng, conversation(rng, number)) for number in range(50)])
    path = str(write_capture(tmp_path / "made.pcap", packets))
    comparison = compare(path, reorder=True)
    assert comparison.unexplained == []
    assert set(comparison.known) <= EXPECTED
    # Told not to reorder, tshark shows fewer.
    assert compare(path).compared[PDU] < comparison.compared[PDU]


@pytest.mark.parametrize("reorder", [False, True])
@pytest.mark.parametrize("seed", range(1, 4))
def test_answers_that_are_lost_and_sent_again(tmp_path: Path, seed: int, reorder: bool) -> None:
    rng = Random(1000 + seed)
    packets = [packet for number in range(60) for packet in sent_again(rng, number)]
    comparison = compare(str(write_capture(tmp_path / "made.pcap", packets)), reorder=reorder)
    assert comparison.unexplained == []
    assert set(comparison.known) <= EXPECTED | BESIDE_GAPS
    if not reorder:
        assert comparison.known["shown-before-the-gap-closed"] + comparison.known["shown-again"] > 0
