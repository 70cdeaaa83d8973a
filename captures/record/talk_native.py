"""The part of the Snap7 library (python-snap7 2, C++) in each session: ``python talk_native.py CONVERSATION PORT``.

If a conversation does not go as expected, also if an expected error is missing, the script ends with an error.
"""

from __future__ import annotations

import contextlib
import ctypes
import datetime as dt
import logging
import sys
import time
from collections.abc import Callable, Sequence

from snap7.client import Client
from snap7.type import Areas, Block, Parameter, S7DataItem, WordLen

ADDRESS = "127.0.0.1"
PE, PA, MK, DB, CT, TM = Areas.PE, Areas.PA, Areas.MK, Areas.DB, Areas.CT, Areas.TM
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
Item = tuple[Areas, int, WordLen, int, int]
"""Area, DB number, transport size, start (bits for Bit, elements for timers and counters, else octets), count."""


def refused(call: Callable[..., object], *arguments: object) -> None:
    """Call, and fail unless the call is refused."""
    try:
        call(*arguments)
    except RuntimeError:
        return
    raise AssertionError(f"{call} was not refused")


def connect(port: int, **parameters: int) -> Client:
    """Connect to rack 0, slot 2; ``parameters`` are Snap7's by name."""
    client = Client()
    client.set_param(Parameter.RemotePort, port)
    for name, value in parameters.items():
        client.set_param(Parameter[name], value)
    client.connect(ADDRESS, 0, 2, port)
    return client


def read(client: Client, area: Areas, db: int, size: WordLen, start: int, count: int) -> bytes:
    """One item by its transport size, which the Python wrapper does not let the caller choose."""
    room = (ctypes.c_uint8 * 4096)()
    result = client._lib.Cli_ReadArea(client._s7_client, area, db, start, count, size, ctypes.byref(room))  # noqa: SLF001
    if result:
        raise RuntimeError(f"read: 0x{result:08x}")
    return bytes(room)


def write(client: Client, area: Areas, db: int, size: WordLen, start: int, count: int, octets: bytes) -> None:
    """As `read`."""
    room = (ctypes.c_uint8 * len(octets))(*octets)
    result = client._lib.Cli_WriteArea(client._s7_client, area, db, start, count, size, ctypes.byref(room))  # noqa: SLF001
    if result:
        raise RuntimeError(f"write: 0x{result:08x}")


def items_of(rows: Sequence[Item], octets: bytes) -> ctypes.Array[S7DataItem]:
    """Items for one PDU; each has ``octets`` to write, or room for read data."""
    items = (S7DataItem * len(rows))()
    for item, (area, db, size, start, count) in zip(items, rows, strict=True):
        item.Area, item.WordLen, item.DBNumber, item.Start, item.Amount = area, size, db, start, count
        room = (ctypes.c_uint8 * 512)(*octets)
        item.pData = ctypes.cast(room, ctypes.POINTER(ctypes.c_uint8))
    return items


def failures(items: Sequence[S7DataItem]) -> int:
    """How many items the server refused."""
    return sum(1 for item in items if item.Result)


def every_item() -> list[Item]:
    """Every area with every transport size, one and several elements, odd and even sizes."""
    rows: list[Item] = []
    for area, db in ((PE, 0), (PA, 0), (MK, 0), (DB, 1)):
        rows.append((area, db, WordLen.Bit, 8 * 10 + 3, 1))
        for size in (WordLen.Byte, WordLen.Char):
            rows += [(area, db, size, 5, 1), (area, db, size, 4, 7)]
        for size in (WordLen.Word, WordLen.Int, WordLen.DWord, WordLen.DInt, WordLen.Real):
            rows += [(area, db, size, 12, 1), (area, db, size, 20, 3)]
    for area, size in ((TM, WordLen.Timer), (CT, WordLen.Counter)):
        rows += [(area, 0, size, 5, 1), (area, 0, size, 0, 4)]
    return rows


def setup_pdu_sizes(port: int) -> None:
    """Three connections that request a PDU length of 240, 480 and 960."""
    for asked in (240, 480, 960):
        client = connect(port, PDURequest=asked)
        assert client.get_pdu_length() == asked
        client.disconnect()


def refused_port(port: int) -> None:
    """Connect where nobody listens."""
    refused(connect, port)


def read_areas(port: int) -> None:
    """Every item there is, then the typed values of DB2."""
    client = connect(port)
    for row in every_item():
        read(client, *row)
    for offset, size in ((1, WordLen.Byte), (2, WordLen.Char), (4, WordLen.Int), (6, WordLen.Word), (8, WordLen.DInt)):
        read(client, DB, 2, size, offset, 1)
    for offset, size, count in ((12, WordLen.DWord, 1), (16, WordLen.Real, 1), (20, WordLen.Char, 8)):
        read(client, DB, 2, size, offset, count)
    client.disconnect()


def write_areas(port: int) -> None:
    """Every item there is."""
    client = connect(port)
    for number, (area, db, size, start, count) in enumerate(every_item()):
        octets = bytes((number + n) % 256 for n in range(count * SIZES.get(size, 2)))
        write(client, area, db, size, start, count, b"\x01" if size is WordLen.Bit else octets)
    client.disconnect()


def item_errors(port: int) -> None:
    """Missing DB, out of range, alone and among existing items; then the same for writes.

    In a write of several items this server loses its place in the data after a REAL: the two good items there fail as well.
    """
    client = connect(port)
    refused(client.db_read, 99, 0, 4)
    refused(client.db_read, 2, 98, 10)
    refused(read, client, MK, 0, WordLen.Byte, 120, 20)
    rows: list[Item] = [
        (DB, 1, WordLen.Byte, 0, 3),
        (DB, 99, WordLen.Byte, 0, 4),
        (DB, 2, WordLen.Real, 16, 1),
        (DB, 2, WordLen.Word, 99, 1),
        (MK, 0, WordLen.Bit, 80, 1),
        (PE, 0, WordLen.Byte, 500, 2),
        (DB, 10, WordLen.Int, 0, 2),
    ]
    result, items = client.read_multi_vars(items_of(rows, bytes(32)))
    assert result == 0
    assert failures(items) == 3
    refused(client.db_write, 99, 0, bytearray(b"\x01\x02"))
    refused(client.db_write, 2, 99, bytearray(b"\x01\x02\x03"))
    written = list(items_of(rows, b"\x01" + bytes(31)))
    client.write_multi_vars(written)
    client.disconnect()


def multi_items(port: int) -> None:
    """20 items in one PDU, the most the protocol allows; and one read that needs several PDUs."""
    client = connect(port, PDURequest=480)
    rows: list[Item] = [(DB, 1, WordLen.Byte, 20 * n, 1 + n % 5) for n in range(12)]
    rows += [(MK, 0, WordLen.Bit, 8 * n + n, 1) for n in range(4)]
    rows += [(PA, 0, WordLen.Word, 2, 3), (TM, 0, WordLen.Timer, 1, 1), (CT, 0, WordLen.Counter, 2, 1)]
    rows += [(DB, 2, WordLen.Real, 16, 1)]
    assert len(rows) == 20
    for _ in range(3):
        result, items = client.read_multi_vars(items_of(rows, bytes(64)))
        assert result == 0
        assert failures(items) == 0
    client.write_multi_vars(list(items_of(rows, b"\x01" * 64)))
    client.write_multi_vars(list(items_of(rows[:7], b"\x02" * 64)))
    assert len(client.db_read(1, 0, 600)) == 600
    client.db_write(1, 0, bytearray(range(250)) * 2)
    client.disconnect()


def szl(port: int) -> None:
    """Lists by the client's own functions, then by number."""
    client = connect(port)
    client.read_szl_list()
    client.get_order_code()
    client.get_cpu_info()
    client.get_cpu_state()
    client.get_cp_info()
    client.get_protection()
    for number, index in ((0x0011, 1), (0x0019, 0), (0x0074, 0), (0x00A0, 0), (0x0111, 6), (0x0132, 4), (0x0D91, 0)):
        client.read_szl(number, index)
    refused(client.read_szl, 0x7777, 0)
    client.read_szl(0x0011, 0x7FFF)
    client.disconnect()


def blocks(port: int) -> None:
    """Counts, DBs, types without a block, existing and missing blocks."""
    client = connect(port)
    client.list_blocks()
    client.list_blocks_of_type(Block.DB, 10)
    for block in (Block.OB, Block.FB, Block.SFC):
        refused(client.list_blocks_of_type, block, 10)
    client.get_block_info(Block.DB, 1)
    client.get_block_info(Block.DB, 2)
    refused(client.get_block_info, Block.DB, 99)
    refused(client.get_block_info, Block.FC, 1)
    client.disconnect()


def clock(port: int) -> None:
    """Read, set to a given and to the present time, read."""
    client = connect(port)
    client.get_plc_datetime()
    client.set_plc_datetime(dt.datetime(2024, 2, 29, 23, 59, 58, tzinfo=dt.UTC))
    client.set_plc_system_datetime()
    client.get_plc_datetime()
    client.disconnect()


def transfer_refused(port: int) -> None:
    """This server refuses uploads and downloads: ROSCTR 2 with an error, not ROSCTR 3."""
    client = connect(port)
    refused(client.upload, 1)
    refused(client.full_upload, Block.DB, 1)
    refused(client.full_upload, Block.OB, 1)
    client.disconnect()


def plc_control(port: int) -> None:
    """Stop and start in every way, and the other PI services."""
    client = connect(port)
    client.get_cpu_state()
    client.plc_stop()
    client.get_cpu_state()
    client.plc_stop()
    client.plc_hot_start()
    client.get_cpu_state()
    client.plc_cold_start()
    client.compress(1000)
    client.copy_ram_to_rom(1000)
    client.delete(Block.DB, 2)
    client.disconnect()


def password(port: int) -> None:
    """A password of 6 and one of 8 characters."""
    client = connect(port)
    client.get_protection()
    client.set_session_password("geheim")
    client.set_session_password("12345678")
    client.clear_session_password()
    client.disconnect()


def poll(client: Client, rounds: int, pause: float) -> None:
    """Read four octets, at another place each round."""
    for number in range(rounds):
        client.db_read(1, 4 * number, 4)
        time.sleep(pause)


def cut(port: int) -> None:
    """The third poll is never answered: the far side ends the connection while the request is open."""
    client = connect(port, RecvTimeout=1000)
    poll(client, 2, 0.01)
    refused(client.db_read, 1, 8, 4)
    client.disconnect()


def give_up(port: int) -> None:
    """The third answer takes longer than this client waits; it closes, and the answer comes after its FIN."""
    client = connect(port, RecvTimeout=300)
    poll(client, 2, 0.01)
    refused(client.db_read, 1, 8, 4)
    client.disconnect()


def lost(port: int) -> None:
    """The third answer never comes; the client times out and continues to poll over the same connection."""
    client = connect(port, RecvTimeout=500)
    poll(client, 2, 0.01)
    refused(client.db_read, 1, 8, 4)
    time.sleep(0.1)
    for _ in range(3):
        with contextlib.suppress(RuntimeError):
            client.db_read(1, 0, 4)
    client.disconnect()


def slow(port: int) -> None:
    """A poll that waits for as long as it takes."""
    client = connect(port, RecvTimeout=3000)
    poll(client, 6, 0.01)
    client.disconnect()


def slivers(port: int) -> None:
    """Long and short requests and answers, for a relay that cuts each into segments of 7 octets."""
    client = connect(port)
    client.db_read(1, 0, 64)
    client.db_write(1, 100, bytearray(range(50)))
    client.read_multi_vars(items_of([(DB, 1, WordLen.Byte, 3 * n, 3) for n in range(5)], bytes(16)))
    refused(client.db_read, 99, 0, 1)
    client.read_szl(0x0011, 0)
    client.disconnect()


def two_clients(port: int) -> None:
    """Half of the session with two clients at once."""
    client = connect(port)
    for number in range(12):
        client.read_area(MK, 0, number, 2)
        time.sleep(0.03)
    client.disconnect()


def interrupted(port: int) -> None:
    """Two polls, then one that is never answered; the recorder kills this process while it waits."""
    client = connect(port, RecvTimeout=30000)
    poll(client, 2, 0.01)
    print("asking", flush=True)
    client.db_read(1, 8, 4)


def mid_stream(port: int) -> None:
    """Reports when its third request is on its way, so that the capture can begin before the answer."""
    client = connect(port, RecvTimeout=5000)
    poll(client, 2, 0.01)
    print("asking", flush=True)
    poll(client, 5, 0.01)
    client.disconnect()


CONVERSATIONS: dict[str, Callable[[int], None]] = {
    name.replace("_", "-"): function
    for name, function in list(globals().items())
    if getattr(function, "__annotations__", {}) == {"port": "int", "return": "None"}
}


if __name__ == "__main__":
    logging.disable(logging.CRITICAL)
    CONVERSATIONS[sys.argv[1]](int(sys.argv[2]))
