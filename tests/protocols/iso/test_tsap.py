from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.iso.tsap import Tsap


@pytest.mark.parametrize(
    ("octets", "text", "described"),
    [
        ("0102", "01.02", "01.02 (PG, rack 0 slot 2)"),
        ("0200", "02.00", "02.00 (OP, rack 0 slot 0)"),
        ("0303", "03.03", "03.03 (S7 basic, rack 0 slot 3)"),
        ("0162", "01.62", "01.62 (PG, rack 3 slot 2)"),
        ("01ff", "01.ff", "01.ff (PG, rack 7 slot 31)"),
        ("1000", "10.00", "10.00 (connection resource 0x10, rack 0 slot 0)"),
        ("0600", "06.00", "06.00 (connection resource 0x06, rack 0 slot 0)"),
        ("4d57", "MW", '"MW"'),  # libnodave to an S7-200
        ("53494d415449432d524f4f542d484d49", "SIMATIC-ROOT-HMI", '"SIMATIC-ROOT-HMI"'),
        ("", "", ""),
        ("01", "01", "01"),
        ("41", "41", "41"),
        ("010203", "010203", "010203"),
        ("411b5b324a", "411b5b324a", "411b5b324a"),  # a text that would clear the screen
        ("4142e2", "4142e2", "4142e2"),
    ],
)
def test_tsaps_as_people_read_them(octets: str, text: str, described: str) -> None:
    tsap = Tsap(bytes.fromhex(octets))
    assert (str(tsap), tsap.describe()) == (text, described)
    assert tsap.octets.hex() == octets
    assert tsap.as_dict()["octets"] == octets
    assert tsap.as_dict()["text"] == text


def test_every_tsap_of_two_octets() -> None:
    for number in range(65536):
        octets = number.to_bytes(2, "big")
        tsap = Tsap(octets)
        printable = all(0x20 <= octet < 0x7F for octet in octets)
        if printable:
            assert (tsap.connection_type, tsap.rack, tsap.slot) == (-1, -1, -1)
        else:
            assert (tsap.connection_type, tsap.rack * 32 + tsap.slot) == (octets[0], octets[1])
            assert 0 <= tsap.rack < 8
            assert 0 <= tsap.slot < 32
        assert ("rack" in tsap.as_dict()) is not printable


@given(st.binary(max_size=40))
def test_any_tsap_can_be_shown(octets: bytes) -> None:
    tsap = Tsap(octets)
    assert tsap.describe().isascii()
    assert tsap.describe().isprintable()
    assert tsap.as_dict()["octets"] == octets.hex()
    assert len(octets) == 2 or tsap.rack == tsap.slot == tsap.connection_type == -1
