"""What stations say of themselves is compared within a network: those of other VLANs may use the same addresses."""

from __future__ import annotations

from tests.engine.findings.station_scenarios import CARD, OTHER_CARD
from tests.engine.stations.answers import components, identification, szl
from tests.engine.transactions.talk import Talk


def test_machines_that_are_alike() -> None:
    """Two machines use the same addresses, one in a VLAN, and a third one in another; they take turns."""
    talk = Talk()
    for turn in range(3):
        for number, vlan in enumerate((0, 20, 30)):
            machine = talk if not turn and not number else Talk(50000 + 10 * turn + number, beside=talk)
            machine.vlan = vlan
            machine.macs = [CARD, bytes((0, 0x1B, 0x1B, 0, 1, number))]
            machine.open()
            szl(machine, 1, identification(f"6ES7 315-2EH1{number}-0AB0", (3, 2, number)))
            szl(machine, 2, components(serial=f"S C-A{number}"))
    talk.pipeline.exchange.report_findings()
    assert [finding.slug for finding in talk.findings if finding.slug.startswith("device.")] == []


def test_another_module_in_a_vlan() -> None:
    """What was said before the first VLAN was seen is of the network without one, and each has its own."""
    talk = Talk()
    talk.macs = [CARD, OTHER_CARD]
    talk.open()
    szl(talk, 1, components(serial="S C-A1"))
    for port, vlan, serial in (
        (50001, 20, "S C-B1"),
        (50002, 20, "S C-B2"),
        (50003, 0, "S C-A2"),
        (50004, 30, "S C-A3"),
    ):
        machine = Talk(port, beside=talk)
        machine.vlan = vlan
        machine.macs = [CARD, OTHER_CARD]
        machine.open()
        szl(machine, 1, components(serial=serial))
    talk.pipeline.exchange.report_findings()
    assert [finding.detail for finding in talk.findings if finding.slug == "device.serial_changed"] == [
        "10.0.0.2 in VLAN 20, rack 0 slot 2: serial number S C-B2, before S C-B1 (SZL 0x001c)",
        "10.0.0.2, rack 0 slot 2: serial number S C-A2, before S C-A1 (SZL 0x001c)",
    ]
