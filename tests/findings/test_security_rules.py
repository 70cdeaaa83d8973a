"""Security findings about writes: what the PLC refused was not written."""

from __future__ import annotations

import pytest

from tests.findings.security_scenarios import MB0, QB0
from tests.transactions.talk import Talk, ack_data, write, written

WRITES = {"security.write", "security.write_outputs"}


@pytest.mark.parametrize(
    ("codes", "said"),
    [
        (b"\xff\xff", WRITES),
        (b"\x03\xff", {"security.write"}),
        (b"\xff\x0a", {"security.write_outputs"}),
        (b"\x03\x0a", set()),
    ],
)
def test_only_what_was_taken_is_reported_as_written(codes: bytes, said: set[str]) -> None:
    talk = Talk()
    talk.open()
    talk.ask(write(1, [QB0, MB0], written(4, b"\x01") + b"\0" + written(4, b"\x01")))
    talk.tell(ack_data(1, b"\x05\x02", codes))
    talk.close()
    talk.finish()
    assert WRITES & set(talk.slugs()) == said


def test_a_refused_write_hides_no_later_one() -> None:
    talk = Talk()
    talk.open()
    for reference, code in ((1, b"\x03"), (2, b"\x03"), (3, b"\xff"), (4, b"\xff")):
        talk.ask(write(reference, [QB0], written(4, b"\x01")))
        talk.tell(ack_data(reference, b"\x05\x01", code))
    talk.close()
    talk.finish()
    assert talk.slugs().count("security.write_outputs") == 1
