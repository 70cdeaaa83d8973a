"""The table of known differences: each entry is met, by a capture made for it, and explains nothing beside it."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from random import Random
from typing import Final

import pytest

from dissect.testing.oracle.compare import compare
from dissect.testing.oracle.known import FORM, KNOWN, OURS, SCOPE, as_markdown
from dissect.testing.oracle.theirs import Frame
from tests.build import dt, pdu, tpdu, tpkt
from tests.cases import each
from tests.examples import S7
from tests.testing.oracle.traffic import ACK, PUSH_ACK, Connection, connect, parameter, setup, write_capture
from tests.tshark import ask

ROOT: Final = Path(__file__).resolve().parents[3]
IDS: Final = [entry.id for entry in KNOWN]

READ: Final = pdu(1, 7, b"\x04\x01\x12\x0a\x10\x02\x00\x03\x00\x01\x84\x00\x00\x00")
ANSWER: Final = pdu(3, 7, b"\x04\x01", b"\xff\x04\x00\x18abc")
#: Answers whose data items count octets, so that nothing about them is known to differ.
PLAIN: Final = [pdu(3, number, b"\x04\x01", b"\xff\x09\x00\x04data") for number in range(8)]
CONNECT_REQUEST: Final = struct.pack(">BHHB", 0xE0, 0, 1, 0)


#: A PI service that nobody knows, with an argument.
SERVICE: Final = b"\x28\x00\x00\x00\x00\x00\x00\xfd\x00\x02EP\x05_XYZW"
#: A data block: its header, code and trailer.
BLOCK: Final = bytes.fromhex("70700101050a0001000000640000000002914760") + bytes(80)


def worked(title: str) -> list[bytes]:
    """The worked examples whose titles begin so."""
    return [example.octets for example in S7 if example.title.startswith(title)]


def userdata(kind_and_group: int, subfunction: int, payload: bytes) -> bytes:
    """Userdata with the extended head."""
    head = bytes([0, 1, 0x12, 8, 0x12, kind_and_group, subfunction, 1, 0, 0, 0, 0])
    return dt(pdu(7, 1, head, b"\xff\x09" + struct.pack(">H", len(payload)) + payload))


def begun(sequence: int = 1000) -> Connection:
    """A connection up to its Setup."""
    rng = Random(1)
    connection = Connection(rng, 1)
    connection.sequence = [sequence, 5000]
    connection.open()
    connection.put(0, PUSH_ACK, connect(Random(5), 0xE0, 0))
    connection.put(1, PUSH_ACK, connect(Random(5), 0xD0, 1))
    connection.put(0, PUSH_ACK, dt(setup(rng, 1, 1)))
    connection.put(1, PUSH_ACK, dt(setup(rng, 3, 1)))
    return connection


def sent(*messages: bytes, side: int = 1) -> list[bytes]:
    """A connection in which one side sends TPKTs, each in a segment."""
    connection = begun()
    for message in messages:
        connection.put(side, PUSH_ACK, message)
    return connection.packets


def late() -> list[bytes]:
    """An answer captured behind its acknowledgement."""
    connection = begun()
    connection.put(0, PUSH_ACK, dt(READ))
    before = connection.sequence[1]
    connection.sequence[1] += len(dt(PLAIN[7]))
    connection.put(0, PUSH_ACK, dt(pdu(1, 8, READ[10:])))
    connection.put(1, PUSH_ACK, dt(PLAIN[7]), before)
    connection.put(1, PUSH_ACK, dt(PLAIN[0]))
    return connection.packets


def early() -> list[bytes]:
    """Two answers, the second of which comes first."""
    connection = begun()
    first, second = dt(PLAIN[1]), dt(PLAIN[2])
    at = connection.sequence[1]
    connection.put(1, PUSH_ACK, second, at + len(first))
    connection.put(1, PUSH_ACK, first, at)
    return connection.packets


def again() -> list[bytes]:
    """An answer twice, which ends where sequence numbers begin anew."""
    connection = begun(sequence=1000)
    message = dt(PLAIN[1])
    connection.sequence[1] = (1 << 32) - 2 * len(message)
    connection.packets.clear()
    connection.put(1, PUSH_ACK, message)
    at = connection.sequence[1]
    connection.put(1, PUSH_ACK, message)
    connection.put(1, PUSH_ACK, message, at)
    return connection.packets


def torn() -> list[bytes]:
    """A message in two DTs, the second of which is missing, and another message."""
    connection = begun()
    message = pdu(3, 9, b"\x04\x01", b"\xff\x09\x00\x64" + bytes(100))
    connection.put(1, PUSH_ACK, dt(message[:60], eot=False))
    connection.sequence[1] += len(dt(message[60:]))
    connection.put(1, PUSH_ACK, dt(PLAIN[1]))
    connection.put(0, PUSH_ACK, dt(READ))
    return connection.packets


def cut_by_a_segment() -> list[bytes]:
    """A clock request with a payload that is no time, and behind it in the segment the beginning of an answer."""
    connection = begun()
    clock = pdu(7, 1, b"\x00\x01\x12\x04\x11\x47\x02\x00", b"\xff\x09\x00\x03abc")
    stream = dt(clock) + dt(PLAIN[1])
    connection.put(1, PUSH_ACK, stream[:-6])
    connection.put(1, PUSH_ACK, stream[-6:])
    return connection.packets


def desktop() -> list[bytes]:
    """Remote Desktop: negotiation instead of parameters, then T.125."""
    connection = Connection(Random(1), 1)
    connection.open()
    connection.put(0, PUSH_ACK, tpdu(CONNECT_REQUEST, b"\x01\x00\x08\x00\x0b\x00\x00\x00"))
    connection.put(1, PUSH_ACK, tpdu(struct.pack(">BHHB", 0xD0, 1, 7, 0), b"\x02\x00\x08\x00\x02\x00\x00\x00"))
    return connection.packets


def desktop_without_negotiation() -> list[bytes]:
    """Remote Desktop as of old: the client names a user, and the server confirms without a word about it."""
    connection = Connection(Random(1), 1)
    connection.open()
    connection.put(0, PUSH_ACK, tpdu(CONNECT_REQUEST, b"Cookie: mstshash=somebody\r\n"))
    connection.put(1, PUSH_ACK, tpdu(struct.pack(">BHHB", 0xD0, 0, 0x1234, 0)))
    return connection.packets


def call() -> list[bytes]:
    """A call of H.323: its CONNECT (Q.931) names the connection on which H.245 then stands in TPKTs."""
    host = (IDS.index("h323") + 1).to_bytes(2, "big")  # where `moved` puts it
    signalling, control = Connection(Random(1), 1, 1720), Connection(Random(1), 1, 10503)
    # H.225: the form of a CONNECT, the protocol's version, the address of H.245, an end without properties, a call's id.
    answer = b"\x02\x40\x06\x00\x08\x91\x4a\x00\x02\x00" + signalling.addresses[1][:2] + host
    answer += struct.pack(">H", control.ports[1]) + bytes(18)
    signalling.open()
    signalling.put(1, PUSH_ACK, tpkt(b"\x08\x02\x80\x01\x07\x7e" + struct.pack(">HB", len(answer) + 1, 5) + answer))
    control.open()
    for side, message in (
        (0, b"\x02\x70\x01\x06\x00\x08\x81\x75\x00\x03\x00"),  # terminal capabilities, like an ER
        (1, b"\x21\x80\x01"),  # their acknowledgement, like a DR
        (0, b"\x01\x00\x01\x23"),
        (1, b"\x02\xf0\x01\x06\x00\x08\x81\x75\x00\x03\x00"),  # like a DT
        (0, b"\x4a"),
    ):
        control.put(side, PUSH_ACK, tpkt(message))
    return signalling.packets + control.packets


def lost_in_a_message() -> list[bytes]:
    """A message with bytes inside that look like a TPKT header, of which the segment begins that follows a lost one."""
    connection = begun()
    inside = b"\x03\xa2\x00\x20\x05\xe0" + bytes(40)
    stream = dt(pdu(3, 9, b"\x04\x01", b"\xff\x09" + struct.pack(">H", 40 + len(inside)) + bytes(40) + inside))
    cut, at = stream.index(inside), connection.sequence[1]
    connection.put(1, PUSH_ACK, stream[cut:], at + cut)
    connection.put(1, PUSH_ACK, stream[:cut], at)
    connection.sequence[1] = at + len(stream)
    connection.put(1, PUSH_ACK, dt(PLAIN[1]))
    return connection.packets


def segments(*order: tuple[int, int] | None) -> list[bytes]:
    """A connection whose server sends five answers in segments from one octet to another, in the order of capture.

    None is a packet of the client that acknowledges nothing of them.
    """
    connection = begun()
    stream, at = b"".join([dt(message) for message in PLAIN[:5]]), connection.sequence[1]
    for places in order:
        if places is None:
            connection.put(0, ACK)
        else:
            connection.put(1, PUSH_ACK, stream[places[0] : places[1]], at + places[0])
    connection.sequence[1] = at + len(stream)
    connection.put(0, PUSH_ACK, dt(READ))
    return connection.packets


#: Octets of an answer of `segments`.
_SIZE: Final = len(dt(PLAIN[0]))

#: For each entry the packets of a capture that shows it.
EXAMPLES: Final[dict[str, Callable[[], list[bytes]]]] = {
    "length-in-octets": lambda: sent(dt(ANSWER)),
    "kept-from-before": lambda: sent(
        dt(pdu(3, 7, b"\x04\x02", b"\xff\x09\x00\x04data\x05\x00\x00\x04")),
        dt(pdu(3, 8, b"\x04\x01", b"\x05\x00\x00\x04")),
    ),
    "userdata-type-of-four-bits": lambda: sent(
        dt(pdu(7, 1, b"\x00\x01\x12\x04\x11\x44\x01\x00", b"\x0a\x00\x00\x00")),
        dt(pdu(7, 2, b"\x00\x01\x12\x04\x11\x60\x03\x00", b"\x0a\x00\x00\x00")),
        side=0,
    ),
    "mode-transition-as-head": lambda: sent(dt(pdu(7, 0, b"\x01\x00\x10\x10\x00\x00\x02\x00"))),
    "usend-as-head": lambda: sent(
        dt(
            pdu(
                7, 0, b"\x00\x01\x12\x08\x13\x06\x02\x00\x00\x00\x00\x01", b"\xff\x09\x00\x08\x00\x01\xff\x09\x00\x02ab"
            )
        )
    ),
    "parts-joined": lambda: sent(*worked("Response, first part"), *worked("Response, second and last part")),
    "last-part-alone": lambda: sent(*worked("Response, second and last part")),
    "time-with-its-century": lambda: sent(*worked("Response with the clock")),
    "count-with-its-reserved-octet": lambda: sent(*worked("Request cyclic"), side=0),
    "fill-of-an-item": lambda: sent(
        dt(pdu(1, 7, b"\x04\x02\x12\x03\x55ab\x00\x12\x0a\x10\x02\x00\x01\x00\x01\x84\x00\x00\x00")), side=0
    ),
    "payload-as-octets": lambda: sent(
        dt(pdu(7, 1, b"\x00\x01\x12\x04\x11\x45\x60\x00", b"\xff\x09\x00\x04some")), side=0
    ),
    "records-without-names": lambda: sent(
        userdata(0x84, 1, b"\x00\x90\x00\x00\x00\x0e\x00\x01" + bytes(14)),
    ),
    "address-of-a-record": lambda: sent(
        dt(pdu(1, 7, b"\x04\x01\x12\x0a\x10\x02\x00\x64\x00\x05\x01\x00\x01\x00")), side=0
    ),
    "fill-of-a-record": lambda: sent(userdata(0x82, 8, b"\x00\x01\xff\x09\x00\x00\x00\x03abc")),
    "archives-as-reserved": lambda: sent(userdata(0x84, 2, b"\x02\x00\x07\x01\xff\x00")),
    "archive-as-octets": lambda: sent(userdata(0x04, 0x10, b"\x12\x06\x13\x00\x00\x00\x00\x05\x04\x00data")),
    "credit-of-a-parameter": lambda: sent(
        tpdu(CONNECT_REQUEST, parameter(0x8C, b"\x00\x00\x00\x01\x00\x01\x00\x04")), side=0
    ),
    "argument-of-unknown-service": lambda: sent(dt(pdu(1, 7, SERVICE)), side=0),
    "name-and-its-fields": lambda: sent(*worked("Job Start upload"), side=0),
    "block-with-its-header": lambda: sent(dt(pdu(3, 1, b"\x1b\x00", b"\x00\x64\x00\xfb" + BLOCK)), side=0),
    "records-as-octets": lambda: sent(
        dt(
            pdu(
                7,
                1,
                b"\x00\x01\x12\x08\x12\x84\x01\x02\x00\x00\x00\x00",
                b"\xff\x09\x00\x30\x02\x32\x00\x04\x00\x28\x00\x01\x00\x04\x00\x01" + bytes(36),
            )
        )
    ),
    "damaged-pdu": lambda: sent(dt(pdu(1, 7, b"\x04\x01\x12\x0c\x10\x02\x00\x01\x00\x01\x84\x00\x00\x00")), side=0),
    "expedited-refused": lambda: sent(tpdu(b"\x10\x80", data=b"urgent")),
    "reason-refused": lambda: sent(tpdu(struct.pack(">BHHB", 0x80, 1, 7, 0x86))),
    "rejection-refused": lambda: sent(
        tpdu(struct.pack(">BHB", 0x70, 1, 2), parameter(0xC1, b"\x06\xe0\x00\x00")),
        tpdu(struct.pack(">BHB", 0x70, 1, 9)),
    ),
    "malformed-tpdu": lambda: sent(tpkt(b"\x03\x40\x00\x00data"), tpkt(b"\x20\xf0\x80data"), tpkt(b"\x03\xe0\x00\x00")),
    "broken-parameter": lambda: sent(
        tpdu(struct.pack(">BHH", 0xC0, 1, 7), b"\x00"), tpdu(struct.pack(">BHH", 0xC0, 1, 7), b"\xc0\x05\x0a")
    ),
    "size-of-65531": lambda: sent(tpdu(CONNECT_REQUEST, parameter(0xC0, b"\x10")), side=0),
    "size-without-meaning": lambda: sent(
        tpdu(CONNECT_REQUEST, parameter(0xC0, b"\x05")),
        tpdu(CONNECT_REQUEST, parameter(0xC0, b"\x0a\x0a")),
        side=0,
    ),
    "header-without-tpdu": lambda: sent(b"\x03\x00\x00\x05\x00", b"\x03\x00\x00\x07\x00\xf0\x80", dt(PLAIN[1])),
    "rdp": desktop,
    "h323": call,
    "header-inside-a-message": lost_in_a_message,
    "shown-before-the-gap-closed": lambda: segments((0, 10), (20, 4 * _SIZE), (10, 20), (4 * _SIZE, 5 * _SIZE)),
    "shown-where-sent-again": lambda: segments((8, _SIZE), (0, 8), None, None, None, (0, _SIZE), (_SIZE, 5 * _SIZE)),
    "cut": lambda: sent(dt(ANSWER), tpdu(CONNECT_REQUEST, parameter(0xC2, bytes(80)))),
    "lost-by-tcp": late,
    "shown-at-the-gap": early,
    "unfinished": cut_by_a_segment,
    "shown-again": again,
    "parameter-of-an-ack": lambda: sent(
        dt(b"\x32\x02\x00\x00\x00\x07\x00\x01\x00\x00\x00\x00\x29"),
        dt(b"\x32\x02\x00\x00\x00\x08\x00\x02\x00\x00\x81\x04\x05\x01"),
    ),
    "joined-over-a-gap": torn,
}


#: Octets of the header of a pcap file, and where the IPv4 addresses of a packet of `Connection` end.
_FILE_HEADER: Final = 24
_ADDRESSES_END: Final = (30, 34)


def moved(packet: bytes, number: int) -> bytes:
    """Return a packet between two hosts of their own."""
    octets = bytearray(packet)
    for end in _ADDRESSES_END:
        struct.pack_into(">H", octets, end - 2, number)
    return bytes(octets)


@pytest.fixture(scope="module")
def captures(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The captures of `EXAMPLES`, each between hosts of its own."""
    folder = tmp_path_factory.mktemp("examples")
    return {
        name: write_capture(
            folder / f"{name}.pcap",
            [moved(packet, number) for packet in EXAMPLES[name]()],
            80 if name == "cut" else 65535,
        )
        for number, name in enumerate(IDS, 1)
    }


def shown(captures: dict[str, Path], names: list[str], reorder: bool) -> dict[str, list[Frame]]:
    """Return what tshark shows of captures joined into one, which is read sooner than it starts again for each."""
    joined = captures[names[0]].with_name(f"joined-{reorder}.pcap")
    contents = [captures[name].read_bytes() for name in names]
    joined.write_bytes(contents[0][:_FILE_HEADER] + b"".join(content[_FILE_HEADER:] for content in contents))
    packets, code, complaint = ask(joined, (), reorder)
    assert code == 0, complaint
    found: dict[str, list[Frame]] = {}
    for name in names:
        count = len(EXAMPLES[name]())
        own, packets = packets[:count], packets[count:]
        for number, layers in enumerate(own, 1):
            layers["frame"]["frame.number"] = str(number)
        found[name] = [Frame(layers) for layers in own if "tpkt" in layers]
    assert packets == []
    return found


def test_every_entry_has_an_example() -> None:
    assert len(set(IDS)) == len(IDS)
    assert EXAMPLES.keys() == set(IDS)


@pytest.mark.parametrize("reorder", [False, True])
def test_entry_is_met(captures: dict[str, Path], reorder: bool) -> None:
    names = [name for name in IDS if (name == "shown-at-the-gap") is reorder]
    frames = shown(captures, names, reorder)
    for name in names:

        def read(path: str, ports: Iterable[int], in_order: bool) -> Iterator[Frame]:
            yield from frames[Path(path).stem]

        comparison = compare(str(captures[name]), read, reorder=reorder)
        assert comparison.unexplained == [], name
        assert comparison.known[name] > 0, name


@each("entry", KNOWN)
def test_entry_says_what_is_right_and_why(entry: object) -> None:
    known = next(one for one in KNOWN if one is entry)
    assert known.side in {OURS, SCOPE, FORM}
    assert known.names
    assert known.what.endswith(".")
    assert known.why.endswith(".")
    assert re.fullmatch(r"\d\.\d+(, \d\.\d+)*", known.reference)


#: More captures for entries that several forms meet.
MORE: Final[dict[str, tuple[str, Callable[[], list[bytes]]]]] = {
    "RDP without negotiation": ("rdp", desktop_without_negotiation),
    "sent again with what was lost": (
        "shown-again",
        lambda: segments((_SIZE, 2 * _SIZE), None, None, None, (0, 3 * _SIZE), (3 * _SIZE, 5 * _SIZE)),
    ),
}


@pytest.mark.parametrize(("name", "packets"), MORE.values(), ids=MORE)
def test_other_forms_of_an_entry(name: str, packets: Callable[[], list[bytes]], tmp_path: Path) -> None:
    comparison = compare(str(write_capture(tmp_path / "made.pcap", packets())))
    assert comparison.unexplained == []
    assert comparison.known[name] > 0


@pytest.mark.parametrize("cut", range(1, _SIZE))
def test_a_gap_that_closes_late(cut: int, tmp_path: Path) -> None:
    """Wherever the gap is: what was lost is sent again behind packets that were captured before."""
    packets = segments((0, cut), (_SIZE + 1, 3 * _SIZE), (3 * _SIZE, 5 * _SIZE), (cut, _SIZE + 1))
    path = str(write_capture(tmp_path / "made.pcap", packets))
    for reorder in (False, True):
        assert compare(path, reorder=reorder).unexplained == []


def test_documentation_shows_the_table() -> None:
    assert as_markdown() in (ROOT / "docs" / "oracle.md").read_text(encoding="utf-8")


def test_references_exist(reference: Path) -> None:
    text = (reference / "s7_protocol.md").read_text(encoding="utf-8")
    headings = set(re.findall(r"^### (\d\.\d+) ", text, re.MULTILINE))
    assert {number for entry in KNOWN for number in entry.reference.split(", ")} <= headings
