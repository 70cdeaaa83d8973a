"""What a reader of a golden is told: who speaks, what does not fit, and nothing that is not so."""

from __future__ import annotations

import pytest

from captures.golden.sources import SOURCES
from dissect.testing.golden import GoldenError, golden_text, parse_golden

HEAD = "s7dissect golden 1\n\nconnection 1\n  protocol s7comm\n\n"
PUSH = "1 server mode transition: STOP\n  wants no answer\n  says Userdata\n    parameters <01 00 10 10 00 00 00 00>\n"


def block(name: str, number: int) -> str:
    """Return the block of a transaction in the golden of a capture."""
    blocks = SOURCES[name].golden.read_text(encoding="utf-8").split("\n\n")
    return next(text for text in blocks if text.startswith(f"{number} "))


def test_what_nobody_asked_for_is_said_by_its_sender() -> None:
    session = parse_golden(HEAD + PUSH)
    assert [(one.asked_by, one.outcome, bool(one.request)) for one in session.transactions] == [
        ("client", "unsolicited", False)
    ]
    assert golden_text(session) == HEAD + PUSH
    by_client = PUSH.replace("1 server", "1 client")
    assert parse_golden(HEAD + by_client).transactions[0].asked_by == "server"


@pytest.mark.parametrize(
    "text", [PUSH.replace("says", "answer"), PUSH.replace("wants no answer", "answer without request")]
)
def test_what_is_said_and_what_is_answered_are_told_apart(text: str) -> None:
    with pytest.raises(GoldenError, match="line 8: use 'says' below 'wants no answer', and 'answer' after a request"):
        parse_golden(HEAD + text)


def test_scd_that_nobody_asked_for_is_said_too() -> None:
    text = '1 server SCD\n  wants no answer\n  says scd\n  scd "says plant: T1"\n  scd "says   0x6041:0 Status = 567"\n'
    session = parse_golden(HEAD + text)
    assert session.transactions[0].scd == ("answer plant: T1", "answer   0x6041:0 Status = 567")
    assert golden_text(session) == HEAD + text


def test_a_read_without_items_says_so() -> None:
    assert golden_text(parse_golden(f"{HEAD}1 client READ\n")) == f"{HEAD}1 client READ\n  # no items\n"


def test_what_does_not_fit_is_told() -> None:
    short, cut = block("crafted/s7-lengths", 2), block("crafted/snaplen", 2)
    assert "# does not fit: s7: param_length at byte 6 claims 210 bytes, the TSDU has 24" in short
    assert "# does not fit: s7: data_length at byte 8 claims 218 bytes, the TSDU has 53" in cut
    assert "does not fit" not in block("crafted/s7-lengths", 18)


def test_a_number_that_is_masked_is_no_job() -> None:
    assert "# job" not in block("crafted/pushes", 11)
    assert "    # on change, checked every 20 s\n" in block("crafted/coverage-userdata", 45)
    assert "# job 4" in block("crafted/coverage-userdata", 47), "this one stands in the payload"
    assert "# job 2 of variable status" in block("crafted/coverage-userdata", 32)


def test_later_pieces_of_a_bsend_have_no_length() -> None:
    said = [block("bsend", number) for number in range(4, 8)]
    assert ["# 1500 bytes" in text for text in said] == [True, False, False, False]
    assert ["# continuation" in text for text in said] == [False, True, True, True]
