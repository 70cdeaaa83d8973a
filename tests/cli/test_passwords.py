"""No output shows a password, whatever the lengths of the PDU say."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import pytest

from dissect.protocols.s7.security import encode_password
from tests.cli.support import run
from tests.meaning.report.support import begun, saved
from tests.properties.messages import JOB, dt, pdu, userdata

Capture = pytest.CaptureFixture[bytes]

SECRET: Final = encode_password(b"geheim")
REQUEST: Final = userdata(1, 1, 5, 1, SECRET)
LOGIN: Final = pdu(JOB, 1, b"\x28" + bytes(6) + b"\xfd\x00\x08\x011\x05nc-pw\x09_N_LOGIN_")
COMMANDS: Final = (
    ("analyze",),
    ("analyze", "-T", "json"),
    ("transactions",),
    ("transactions", "-T", "jsonl"),
    ("show",),
    ("show", "-V"),
    ("show", "-T", "jsonl"),
    ("operations",),
    ("operations", "-T", "jsonl"),
    ("golden",),
)


def lies(octets: bytes, places: tuple[int, ...]) -> list[bytes]:
    return [octets[:at] + bytes((value,)) + octets[at + 1 :] for at in places for value in (0, 1, 12, 16, 20, 0xFF)]


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    talk = begun()
    for octets in [
        REQUEST,
        LOGIN,
        *lies(REQUEST, (6, 7, 8, 9, 11, 12, 13, 20, 21)),
        *lies(LOGIN, (6, 7, 9, 18, 19, 20, 22)),
    ]:
        talk.send(0, dt(octets))
    for li in (1, 3, 4, 7):
        talk.send(0, (b"\x03\x00" + (7 + len(REQUEST)).to_bytes(2, "big") + bytes((li, 0xF0, 0x80))) + REQUEST)
    talk.send(0, dt(REQUEST[:20])[:6] + b"\x00" + REQUEST[:20]).send(0, dt(REQUEST[20:]))
    return saved(tmp_path_factory.mktemp("passwords") / "x.pcapng", talk.packets())


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_no_output_shows_a_password(capfdbinary: Capture, capture: Path, command: tuple[str, ...]) -> None:
    ran = run(capfdbinary, *command, capture)
    assert ran.code in {0, 1}
    said = ran.out + ran.err
    assert said
    for shown in ("geheim", "nc-pw", SECRET[:5].hex(), SECRET[:5].hex(" "), b"nc-pw".hex(), b"nc-pw".hex(" ")):
        assert shown not in said
