"""A capture with each of 200 naughty strings in all places where a device, a client or the writer of the file puts text."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from tests.packets.source.craft import Pcapng
from tests.properties import messages
from tests.properties.messages import Item, dt
from tests.properties.packets import Flow, Talk

_BASIS: Final = (
    "\x1b[31mred\x1b[0m", "\x1b]0;title\x07", "\x1b]8;;http://x\x1b\\link", "\x1bP+q\x1b\\", "\x1b[6n", "\x1bc",
    "\x9b2J", "\x90q\x9c", "\x85next", "\x7f\x08\x08", "a\rb", "c\nd", "\te", "\x0b\x0c", "\x00nul\x00", "\x07bell",
    "\u202egnp.exe", "\u202dlrow\u202c", "\u2066x\u2069", "\u200e\u200f\u061c", "\u2028line", "\u2029par", "\u200bzero",
    "\ufeffbom", "\u00adsoft", "\ue000own", "\U000e0041tag", "\ufffe\uffff", "e\u0301" * 30, "Z\u0351\u0352" * 20,
    "=HYPERLINK(1)", "+1+1", "-2+3", "@SUM(1)", "x;=1+1", "\uff1d1", "=cmd|' /C calc'!A0", "0x=1", "-1", "1e9",
    "\"quoted\"", "'single'", "`tick`", "a,b;c\td", "<script>alert(1)</script>", "</testcase>", "]]>", "<![CDATA[x]]>",
    "&amp;&#0;&lol;", "<?xml?>", "{\"a\":1}", "\\u0000\\x1b", "${PATH}", "$(id)", "|id", ";id", "%s%n%x", "{0.__class__}",
    "{{7*7}}", "[red]X[/]", "[link=file:///]x", "../../etc/passwd", "C:\\CON", "/dev/null", "-rf", "--help", "~root",
    "null", "NaN", "undefined", "True", "# HELP x", "connection 1", "    data <00>", "1 client SETUP", "\U0001f4a9" * 8,
    "\u0130\u0131iI", "\u00df\ufb01", "\u041d\u0430\u0441\u043e\u0441", "\u0634\u0643",
    "long" * 40, " ", "", "\u3000", "\u2800", "0" * 60,
)  # fmt: skip
#: Octets that are not UTF-8, which a TSAP, a comment or a name may contain nevertheless.
_RAW: Final = (
    b"\xff\xfe\x80",
    b"\xc3\x28",
    b"\xed\xa0\x80",
    b"\xf4\x90\x80\x80",
    b"\xc0\xaf",
    b"\x00\x01",
    b"\x80" * 9,
)


def strings() -> list[bytes]:
    """Return the strings: as UTF-8, as Latin-1 if possible, and in the middle of other text."""
    said = [text.encode() for text in _BASIS] + list(_RAW)
    said += [text.encode("latin-1") for text in _BASIS if not text.isascii() and max(text) < "\u0100"]
    said += [b"ab" + one + b"cd" for one in said]
    unique = list(dict.fromkeys(one[:160] for one in said))
    assert len(unique) >= 180
    unique += [bytes((octet, 0x41)) for octet in (*range(0x01, 0x10), *range(0x80, 0x90))]
    return unique


def _talk(number: int, said: bytes) -> Talk:
    """Return a connection in which ``said`` is a TSAP, a value read and written, a symbol, and names of all kinds."""
    talk = Talk(Flow(ports=(10000 + number, 102)))
    talk.send(0, messages.connect(0xE0, called=said[:60])).send(1, messages.connect(0xD0, called=said[:60]))
    text = Item(0x03, len(said) or 1, 1, 0x84, 0)
    content = said or b" "
    talk.send(0, dt(messages.read_job(1, [text]))).send(1, dt(messages.read_answer(1, [text], [content])))
    symbol = bytes((0x12, 1 + len(said[:100]), 0xB2)) + said[:100]
    talk.send(0, dt(messages.pdu(messages.JOB, 3, b"\x04\x01" + symbol)))
    service = b"\x28" + bytes(7) + b"\x00\x00" + bytes((len(said),)) + said
    talk.send(0, dt(messages.pdu(messages.JOB, 4, service))).send(1, dt(messages.pdu(3, 4, b"\x28", error=0x8104)))
    upload = b"\x1d" + bytes(7) + bytes((len(said),)) + said
    talk.send(0, dt(messages.pdu(messages.JOB, 5, upload))).send(
        1, dt(messages.pdu(3, 5, b"\x1d\x00\x01\x00\x00\x00\x00\x07\x070000100"))
    )
    talk.send(0, dt(messages.userdata(6, 1, 4, 1, b"\x00\x1c\x00\x00")))
    names = b"\x00\x1c\x00\x00\x00\x22\x00\x01\x00\x01" + said[:32].ljust(32, b"\0")
    talk.send(1, dt(messages.userdata(6, 2, 4, 1, names)))
    blocks = b"\x5f\x30\x42" + said[:5].ljust(5, b"0") + b"A"
    talk.send(0, dt(messages.userdata(7, 1, 3, 3, blocks)))
    return talk


def write(path: Path, chosen: list[bytes] | None = None) -> Path:
    """Write the capture; the file itself has the strings in its section, interfaces, names of addresses and comments.

    ``chosen`` are at least five strings to use instead of all.
    """
    said = chosen or strings()
    file = Pcapng(begin=False)
    about = b"".join([Pcapng().option(code, said[code]) for code in (1, 2, 3, 4)])
    file.section(options=about + file_end())
    for number, one in enumerate(said):
        file.interface(1, options=b"".join([file.option(code, one) for code in (2, 3, 12)]) + file.resolution(9))
        record = b"\x0a\x00\x00\x01" + one.replace(b"\0", b"") + b"\0"
        file.block(
            4, (1).to_bytes(2, "little") + len(record).to_bytes(2, "little") + record + bytes(-len(record) % 4 + 4)
        )
        for packet in _talk(number, one).packets():
            comment = file.option(1, one) + file_end() if one else b""
            time_ns = packet.time_ns + number * 10**9
            file.packet(time_ns, time_ns, packet.octets, number, packet.wire_length, comment)
    path.write_bytes(file.octets)
    return path


def file_end() -> bytes:
    """Return the end of options."""
    return bytes(4)
