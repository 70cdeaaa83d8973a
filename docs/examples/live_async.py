"""Watch an interface beside other tasks of an asyncio program."""

import asyncio
import sys

import dissect


async def watch(interface: str, queue: asyncio.Queue[dissect.Finding | None]) -> None:
    """Queue findings as they come, and None at the end."""
    async with dissect.live(interface, pdus=False) as events:
        async for event in events:
            if isinstance(event, dissect.Finding):
                await queue.put(event)
    await queue.put(None)


async def report(queue: asyncio.Queue[dissect.Finding | None]) -> None:
    """Do something with findings, here print them."""
    while (finding := await queue.get()) is not None:
        print(finding)


async def main() -> None:
    """Run both."""
    queue: asyncio.Queue[dissect.Finding | None] = asyncio.Queue(1000)
    async with asyncio.TaskGroup() as group:
        group.create_task(watch(sys.argv[1], queue))
        group.create_task(report(queue))


asyncio.run(main())
