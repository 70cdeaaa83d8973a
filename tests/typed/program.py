"""A program of a user, which type checkers read and nobody runs (tests/test_api.py)."""

from pathlib import Path
from typing import reveal_type

import dissect
from dissect import scd
from dissect.engine.observer import Observer

analysis = dissect.analyze("a.pcap", "b.pcap", slow_ns=5)
reveal_type(analysis.latencies.quantile(0.5))
reveal_type(analysis.as_dict())
for event in dissect.open("a.pcap", pdus=False):
    reveal_type(event)
    if isinstance(event, dissect.Transaction):
        reveal_type(event.latency_ns)
        reveal_type(event.errors)
        for result in event.s7_results:
            reveal_type(result.value)
for event in dissect.open("a.pcap", scd=scd.load("plant.toml"), bind=Path("plant.bind.toml")):
    if isinstance(event, dissect.ScdMessage):
        reveal_type(event.message.values)
        for row in event.values:
            reveal_type(row.name)
            reveal_type(row.physical)
    if isinstance(event, dissect.Transaction):
        reveal_type(event.scd)
dissect.analyze("a.pcap", scd="plant.scd", bind="plant.bind.toml")
od = scd.load("plant.toml")
print(od["Pump 1"]["run"].encode(True), od["Pump 1.run"].bits, od[0x6000]["run"].bits)
reveal_type(od.variable("Pump 1.run").encode(True))


class Mine(Observer):
    def transaction(self, transaction: dissect.Transaction) -> None:
        reveal_type(transaction.connection.client)


run = dissect.Run(["a.pcap"], Mine(), dissect.Options(slow_ns=1))
while run.step():
    pass

with dissect.live("eth0", filter="tcp port 102") as events:
    for event in events:
        if isinstance(event, dissect.Transaction):
            reveal_type(event.items)
reveal_type(dissect.stream(("10.0.0.1", 4000), ("10.0.0.2", 102)).client_sent(b""))
with Path("a.pcap").open("rb") as file:
    dissect.analyze(file, [(1, 1, b"")])
try:
    dissect.analyze("missing.pcap")
except dissect.Error as error:
    print(error)


def numbers(transaction: dissect.Transaction) -> dict[str, int]:
    """Attributes are Python numbers, whatever the compiler makes of them."""
    latency: int = transaction.latency_ns or 0
    return {transaction.function_name: transaction.number + transaction.request_frame + latency}


def refused(path: Path) -> list[str]:
    return [
        f"{item.address} {item.type}: {item.result}"
        for event in dissect.open(path, where=dissect.Where("error.code"), pdus=False)
        if isinstance(event, dissect.Transaction)
        for item in event.items
        if not item.ok
    ]


async def follow(interface: str) -> int:
    total = 0
    async with dissect.live(interface) as events:
        async for event in events:
            if isinstance(event, dissect.Finding):
                total += len(event.frames)
    return total


for found in dissect.values("a.pcap", of=["DB1.DBW0"], refusals=True):
    print(found.name, found.value, found.time_ns / 1_000_000_000)
for device in dissect.devices("a.pcap"):
    print(device.address, device.role, device.latencies.quantile(0.5))
for block in dissect.blocks("a.pcap"):
    print(block.label, block.octets.hex())
for table in dissect.frames("a.pcap", library="arrow"):
    print(table)
