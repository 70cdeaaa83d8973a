"""A synthetic capture of cases that no capture of the project has: one more for the comparison."""

from __future__ import annotations

from pathlib import Path

from tests.build import data_item, userdata_head
from tests.engine.stations.answers import listed
from tests.meaning.report.support import WORD, read, saved
from tests.properties import messages
from tests.properties.messages import Item, dt, tpkt
from tests.properties.packets import EPOCH_NS, Flow, Packet, Talk

_SECOND = 1_000_000_000
#: A TPDU header that cannot hold data.
_IMPOSSIBLE = b"\x00\xf0\x80"


def made(folder: Path) -> Path:
    """Write the capture: three connections, one after another, a minute apart."""
    packets: list[Packet] = []
    for number, talk in enumerate((_elsewhere(), _behind(), _twice())):
        packets += talk.packets(EPOCH_NS + 60 * number * _SECOND, 10_000_000)
    return saved(folder / "made.pcapng", packets)


def _begun(flow: Flow, called: bytes = b"\x01\x02") -> Talk:
    talk = Talk(flow).handshake()
    talk.send(0, messages.connect(0xE0, called=called)).send(1, messages.connect(0xD0, called=called))
    asked, told = messages.setup(messages.JOB, 0, 8, 960), messages.setup(messages.ACK_DATA, 0, 4, 480)
    return talk.send(0, dt(asked)).send(1, dt(told))


def _elsewhere() -> Talk:
    """In a VLAN, to rack 1 slot 3: a station states its place, and refuses an item."""
    talk = _begun(Flow("192.0.2.1", "192.0.2.2", vlans=(7,)), b"\x01\x23")
    names = {1: b"Station", 2: b"CPU", 3: b"Plant A", 5: b"S C-1234", 11: b"Hall 3"}
    records = [number.to_bytes(2, "big") + name.ljust(32, b"\0") for number, name in names.items()]
    content = listed(0x001C, 0, *records)
    talk.send(0, dt(messages.userdata(2, 1, 4, 1, content[:4])))
    told = messages.pdu(messages.USERDATA, 2, userdata_head(2, 4, 1, 0, 0), data_item(0xFF, 9, content))
    return read(talk.send(1, dt(told)), 3, content=0x0A).close()


def _behind() -> Talk:
    """Requests behind a malformed header: without an answer, and with one; and an answer without a request."""
    talk = _begun(Flow("192.0.2.3", "192.0.2.4"))
    stop = messages.pdu(messages.JOB, 9, b"\x29" + bytes(5) + b"\x09P_PROGRAM")
    talk.send(0, tpkt(_IMPOSSIBLE + stop), tpkt(_IMPOSSIBLE + messages.read_job(5, [WORD])))
    talk.send(1, dt(messages.read_answer(5, [WORD], [b"\0\7"])))
    return read(talk.send(1, tpkt(_IMPOSSIBLE + messages.read_answer(66, [WORD], [b"\0\x08"]))), 7).close()


def _twice() -> Talk:
    """A request that TCP sends again after 200 ms, before it is answered."""
    talk = _begun(Flow("192.0.2.5", "192.0.2.6"))
    again = talk.put(0, 0x18, dt(messages.write_job(4, [Item(0x04, 1, 10, 0x84, 32)], [b"\0\1"])))
    for _ in range(20):  # the other side is alive
        talk.ack(1)
    talk.segments.append(again)
    return talk.send(1, dt(messages.write_answer(4, [0xFF]))).close()
