"""The part of pure Python python-snap7 3 in each session: ``python talk_python.py CONVERSATION PORT``.

If a conversation does not go as expected, also if an expected error is missing, the script ends with an error.
"""

from __future__ import annotations

import datetime as dt
import logging
import sys
import time
from collections.abc import Callable
from pathlib import Path

from snap7.client import Client
from snap7.error import S7Error
from snap7.type import Area, Block, WordLen

ADDRESS = "127.0.0.1"
BLOCKS = Path(__file__).resolve().parent / "blocks"
"""Blocks of our own, made by our assembler (tests/protocols/mc7/samples.py)."""
PE, PA, MK, DB, CT, TM = Area.PE, Area.PA, Area.MK, Area.DB, Area.CT, Area.TM
SIZES = {
    WordLen.Bit: 1,
    WordLen.Byte: 1,
    WordLen.Char: 1,
    WordLen.Word: 2,
    WordLen.Int: 2,
    WordLen.DWord: 4,
    WordLen.DInt: 4,
    WordLen.Real: 4,
}
"""Octets of one element."""


def refused(call: Callable[..., object], *arguments: object) -> None:
    """Call, and fail unless the call is refused."""
    try:
        call(*arguments)
    except (S7Error, RuntimeError):
        return
    raise AssertionError(f"{call} was not refused")


def connect(port: int) -> Client:
    """Connect to rack 0, slot 1."""
    client = Client()
    client.connect(ADDRESS, 0, 1, port)
    return client


def connect_close(port: int) -> None:
    """CR/CC, Setup, DR/DC, FIN."""
    client = connect(port)
    assert client.get_pdu_length() == 480
    client.disconnect()
    time.sleep(0.2)


def refused_full(port: int) -> None:
    """The server accepts one client; it disconnects the second one."""
    first = connect(port)
    refused(connect, port)
    first.db_read(1, 0, 4)
    first.disconnect()


def read_areas(port: int) -> None:
    """Every area by every transport size, one and three elements."""
    client = connect(port)
    for area, db in ((PE, 0), (PA, 0), (MK, 0), (DB, 1)):
        client.read_area(area, db, 8 * 10 + 3, 1, WordLen.Bit)
        for size in SIZES:
            if size is not WordLen.Bit:
                client.read_area(area, db, 12, 1, size)
                client.read_area(area, db, 20, 3, size)
    client.read_area(TM, 0, 5, 1)
    client.read_area(CT, 0, 2, 3)
    client.disconnect()


def write_areas(port: int) -> None:
    """The same in writing."""
    client = connect(port)
    for area, db in ((PE, 0), (PA, 0), (MK, 0), (DB, 1)):
        client.write_area(area, db, 8 * 10 + 3, bytearray(b"\x01"), WordLen.Bit)
        for size, octets in SIZES.items():
            if size is not WordLen.Bit:
                client.write_area(area, db, 12, bytearray(range(octets)), size)
                client.write_area(area, db, 20, bytearray(range(3 * octets)), size)
    client.write_area(TM, 0, 5, bytearray(b"\x20\x10"))
    client.write_area(CT, 0, 2, bytearray(b"\x01\x23"))
    client.disconnect()


def item_errors(port: int) -> None:
    """A read that fails has an item return code; a write that fails has an error in this server's header."""
    client = connect(port)
    refused(client.db_read, 99, 0, 4)
    refused(client.db_read, 2, 98, 10)
    scattered = [{"area": DB, "db_number": db, "start": 0, "size": 4} for db in (1, 99, 10)]
    refused(client.read_multi_vars, scattered)
    refused(client.db_write, 99, 0, bytearray(b"\x01\x02"))
    refused(client.db_write, 2, 99, bytearray(b"\x01\x02\x03"))
    client.disconnect()


def scattered(client: Client, stride: int) -> None:
    """Read 20 variables, ``stride`` octets apart."""
    items = [{"area": DB, "db_number": 1, "start": stride * n, "size": 1 + n % 4} for n in range(20)]
    result, data = client.read_multi_vars(items)
    assert result == 0
    assert len(data) == 20


def multi_items(port: int) -> None:
    """20 variables: too far apart to be merged (one request of 20 items), then close together (merged into one item)."""
    client = connect(port)
    for _ in range(3):
        scattered(client, 29)
    scattered(client, 5)
    client.disconnect()


def poll_large(client: Client, items: list[dict[str, int]]) -> None:
    """Three rounds of items too large for one PDU: this client sends up to four jobs before it reads an answer."""
    for _ in range(3):
        result, data = client.read_multi_vars(items)
        assert result == 0
        assert len(data) == len(items)


def many_open(port: int) -> None:
    """Three jobs at a time, of three, three and two items, although Setup granted one job."""
    client = connect(port)
    items = [{"area": area, "start": 0, "size": 120} for area in (PE, PA, MK)]
    items += [{"area": DB, "db_number": 1, "start": 148 * n, "size": 140} for n in range(4)]
    poll_large(client, [*items, {"area": DB, "db_number": 10, "start": 0, "size": 60}])
    client.disconnect()


def pairs(port: int) -> None:
    """Two jobs at a time, for a relay that sends two answers in one segment."""
    client = connect(port)
    items = [{"area": DB, "db_number": 1, "start": 70 * n, "size": 64} for n in range(8)]
    poll_large(client, items + [{"area": MK, "start": 64 * n, "size": 56} for n in range(2)])
    client.disconnect()


def szl(port: int) -> None:
    """This server refuses with a return code in the data; the error code of the parameters stays 0."""
    client = connect(port)
    client.read_szl_list()
    client.get_order_code()
    client.get_cpu_info()
    client.get_cp_info()
    client.get_protection()
    client.get_cpu_state()
    refused(client.read_szl, 0x7777, 0)
    client.disconnect()


def blocks(port: int) -> None:
    """Counts, DBs, no FBs, one DB, a missing DB."""
    client = connect(port)
    client.list_blocks()
    client.list_blocks_of_type(Block.DB, 10)
    client.list_blocks_of_type(Block.FB, 10)
    client.get_block_info(Block.DB, 1)
    refused(client.get_block_info, Block.DB, 99)
    client.disconnect()


def clock(port: int) -> None:
    """Read, set, read."""
    client = connect(port)
    client.get_plc_datetime()
    client.set_plc_datetime(dt.datetime(2024, 2, 29, 23, 59, 58, tzinfo=dt.UTC))
    client.get_plc_datetime()
    client.disconnect()


def transfer(port: int) -> None:
    """Upload in one part and in two, download in one part and in two (then the server asks), and the refused cases."""
    client = connect(port)
    assert len(client.upload(10)) == 64
    assert len(client.upload(1)) == 600
    refused(client.upload, 99)
    client.download(bytearray(range(60)), 10)
    client.download(bytearray(600), 1)
    refused(client.download, bytearray(10), 99)
    client.disconnect()


def program(port: int) -> None:
    """Load our own program, then one of its blocks with another time value; the client calls every block DB 1."""
    client = connect(port)
    for name in ("ob1-35s", "fc5", "fb7", "ob1-10s"):
        client.download(bytearray((BLOCKS / f"{name}.mc7").read_bytes()), 1)
    client.disconnect()


def twice(port: int) -> None:
    """A relay sends the third answer twice; this client drops the stale one when it reads the next."""
    client = connect(port)
    for number in range(6):
        client.db_read(1, 4 * number, 4)
    client.disconnect()


def two_clients(port: int) -> None:
    """The other half of the session with two clients at once."""
    client = connect(port)
    for number in range(12):
        client.db_read(1, 2 * number, 2)
        time.sleep(0.03)
    client.disconnect()


CONVERSATIONS: dict[str, Callable[[int], None]] = {
    name.replace("_", "-"): function
    for name, function in list(globals().items())
    if getattr(function, "__annotations__", {}) == {"port": "int", "return": "None"}
}


if __name__ == "__main__":
    logging.disable(logging.CRITICAL)
    CONVERSATIONS[sys.argv[1]](int(sys.argv[2]))
