"""Scenarios of the rules about devices. A silent scenario is the nearest harmless neighbour of one that triggers the rule."""

from __future__ import annotations

from tests.engine.findings.plus_scenarios import begun, opened
from tests.engine.findings.registry import silent, speaks
from tests.engine.stations.answers import components, identification, szl
from tests.engine.transactions.talk import Talk, dbw, read

CARD = bytes.fromhex("001b1b000001")
OTHER_CARD = bytes.fromhex("001b1b000002")
ORDER = "6ES7 315-2EH14-0AB0"


@speaks("device.order_number_changed")
def a_different_module(talk: Talk) -> None:
    talk.open()
    szl(talk, 1, identification(ORDER, (3, 2, 6)))
    frame = szl(talk, 2, identification("6ES7 317-2EK14-0AB0", (3, 2, 6)))
    talk.pipeline.exchange.report_findings()
    assert talk.findings[-1].detail == (
        "10.0.0.2, rack 0 slot 2: order number 6ES7 317-2EK14-0AB0, before 6ES7 315-2EH14-0AB0 (SZL 0x0011)"
    )
    assert talk.findings[-1].frames == [frame - 1, frame]


@speaks("device.serial_changed")
def a_different_serial_number(talk: Talk) -> None:
    talk.open()
    szl(talk, 1, components(serial="S C-A1"))
    szl(talk, 2, components(serial="S C-B2"))


@speaks("device.firmware_changed")
def an_update(talk: Talk) -> None:
    begun(talk)
    opened(talk)
    opened(talk, 0x387, "1;6ES7 215-1AG40-0XB0 ;V4.5")


@silent("device.order_number_changed", "device.serial_changed", "device.firmware_changed")
def the_same_again(talk: Talk) -> None:
    """The same is stated twice, with blanks, and by a less exact source."""
    talk.open()
    szl(talk, 1, identification(ORDER, (4, 3, 1)))
    szl(talk, 2, identification(f"{ORDER} ", (4, 3, 1)))
    szl(talk, 3, components(serial="S C-A1"))
    szl(talk, 4, components(serial="S C-A1", station="a different name"))
    opened(talk, version=f"1;{ORDER} ;V4.3")


@speaks("device.mac_changed")
def a_different_card(talk: Talk) -> None:
    talk.macs = [CARD, OTHER_CARD]
    talk.open()
    again = Talk(50001, beside=talk)
    again.macs = [CARD, bytes.fromhex("000e8c0000bb")]
    again.open()
    talk.pipeline.exchange.report_findings()
    assert talk.findings[-1].detail == "10.0.0.2: MAC address 00:0e:8c:00:00:bb, before 00:1b:1b:00:00:02 (Ethernet)"


@silent("device.mac_changed")
def the_same_card(talk: Talk) -> None:
    """The same cards, and a shared address of redundant routers, which is only sent to."""
    talk.macs = [CARD, OTHER_CARD]
    talk.open()
    again = Talk(50001, beside=talk)
    again.macs = [CARD, OTHER_CARD]
    again.hello()
    again.connect()
    late = Talk(50002, beside=talk)
    late.macs = [CARD, bytes.fromhex("00005e000101")]
    late.ask(read(1, dbw(1, 0)))
    late.ask(read(2, dbw(1, 0)))
