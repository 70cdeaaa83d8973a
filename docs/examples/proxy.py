"""Relay between a client and a PLC with asyncio, and report what they say: `proxy.py PLC PORT`."""

import asyncio
import sys
from collections.abc import Callable

import dissect


async def pump(
    reader: asyncio.StreamReader, writer: asyncio.StreamWriter, take: Callable[[bytes], list[object]]
) -> None:
    """Pass on what one side sends, and hand it to the analyzer."""
    while octets := await reader.read(65536):
        writer.write(octets)
        await writer.drain()
        for event in take(octets):
            if isinstance(event, dissect.Transaction):
                print(event, [item.value for item in event.items])
    writer.close()


async def relay(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Connect to the PLC for a client, and relay until both have closed."""
    host, port = sys.argv[1], int(sys.argv[2])
    plc_reader, plc_writer = await asyncio.open_connection(host, port)
    talk = dissect.stream(writer.get_extra_info("peername"), (host, port), pdus=False)
    await asyncio.gather(pump(reader, plc_writer, talk.client_sent), pump(plc_reader, writer, talk.server_sent))
    print(*[event for event in talk.close() if isinstance(event, dissect.Connection)])


async def main() -> None:
    """Listen for clients."""
    server = await asyncio.start_server(relay, "127.0.0.1", 0)
    print("listening on port", server.sockets[0].getsockname()[1])
    async with server:
        await server.serve_forever()


asyncio.run(main())
