"""Machines that are alike use the same addresses in VLANs of their own: nothing is said of two of them as of one."""

from __future__ import annotations

from captures.craft.mc7 import OB1, OB1_CHANGED
from tests.engine.findings.block_scenarios import load, read_out
from tests.engine.findings.security_scenarios import put
from tests.engine.transactions.talk import Talk, item

MB0 = item(0x83, 0, 0, 2)


def machines(*places: tuple[int, int]) -> list[Talk]:
    """A connection for each network and client, captured together."""
    first = Talk()
    talks = [first, *[Talk(50000 + number, beside=first) for number in range(1, len(places))]]
    for talk, (vlan, client) in zip(talks, places, strict=True):
        talk.vlan = vlan
        talk.hosts = [client, 2]
        talk.open()
    return talks


def details(talks: list[Talk], slug: str) -> list[str]:
    talks[0].pipeline.exchange.report_findings()
    return [finding.detail for finding in talks[0].findings if finding.slug == slug]


def test_each_machine_has_a_client_of_its_own_that_writes() -> None:
    talks = machines((10, 1), (20, 9))
    for talk in talks:
        put(talk, MB0)
    assert details(talks, "security.new_writer") == []


def test_another_client_in_the_same_network_writes() -> None:
    talks = machines((10, 1), (10, 9))
    for talk in talks:
        put(talk, MB0)
    (detail,) = details(talks, "security.new_writer")
    assert detail.endswith("until now only 10.0.0.1 in VLAN 10 wrote to 10.0.0.2 in VLAN 10")


def test_each_machine_has_a_program_of_its_own() -> None:
    """What runs in one was read out, a different block is loaded into the other."""
    one, other = talks = machines((10, 1), (20, 1))
    read_out(one, OB1)
    load(other, OB1_CHANGED)
    assert details(talks, "block.differs") == details(talks, "block.changed") == []
    load(one, OB1_CHANGED)
    assert details(talks, "block.differs") + details(talks, "block.changed") != []
