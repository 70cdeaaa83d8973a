"""Fields: every one that holds octets is known to the table, or becomes zeros; numbers stay."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterator

import dissect.protocols.s7
from dissect.files.anonymize import rules
from dissect.files.anonymize.account import KEEP, Account, Choices
from dissect.files.anonymize.addresses import AddressMap
from dissect.files.anonymize.key import Key
from dissect.files.anonymize.messages import plan_tsdu
from dissect.files.anonymize.rewrite_plan import RewritePlan
from dissect.protocols.s7.build import build_data_item, build_item, build_pdu, build_variables, with_reference
from dissect.protocols.s7.data_parts import CONTENT
from dissect.protocols.s7.security import ENCODED_PASSWORD
from dissect.protocols.s7.szl_records import ETHERNET, IDENTIFICATION
from dissect.protocols.s7.tables import JOB, READ_VAR, WRITE_VAR
from dissect.wire import layout
from dissect.wire.layout import (
    HOLDS_ADDRESS,
    HOLDS_ARGUMENT,
    HOLDS_CODE,
    HOLDS_MAC,
    HOLDS_REFERENCE,
    HOLDS_SECRET,
    HOLDS_SERVICE,
    HOLDS_VALUE,
    Layout,
)
from dissect.wire.part import OCTETS, Part

#: Fields that become zeros with the reserved ones: those whose meaning nobody knows.
UNKNOWN = frozenset(("aseg", "eseg", "octets", "rest", "status"))


def layouts() -> Iterator[Layout]:
    seen: set[int] = set()
    for module in pkgutil.iter_modules(dissect.protocols.s7.__path__):
        for thing in vars(importlib.import_module(f"dissect.protocols.s7.{module.name}")).values():
            for one in (
                thing.values() if isinstance(thing, dict) else thing if isinstance(thing, (list, tuple)) else [thing]
            ):
                if isinstance(one, Layout) and id(one) not in seen:
                    seen.add(id(one))
                    yield one


def test_of_every_field_of_octets_somebody_said_what_it_holds() -> None:
    fields = [field for one in layouts() for field in one.fields if field.means is not None]
    assert len({field.name for field in fields}) > 50
    silent = {field.name for field in fields if not field.holds and not field.name.startswith("reserved")}
    assert silent == UNKNOWN


def test_every_kind_of_content_has_a_rule() -> None:
    kinds = {value for name, value in vars(layout).items() if name.startswith("HOLDS_")}
    ruled = rules._PUBLIC | set(rules._REPLACED) | {
        HOLDS_VALUE, HOLDS_CODE, HOLDS_ADDRESS, HOLDS_MAC, HOLDS_ARGUMENT, HOLDS_SERVICE, HOLDS_SECRET,
    }  # fmt: skip
    held = {field.holds for one in layouts() for field in one.fields if field.means is not None}
    assert kinds - ruled == {HOLDS_REFERENCE}, "a number, and numbers stay"
    assert held - {""} == ruled, "a kind that no field holds is not needed"


def treated(part_layout: Layout, octets: bytes, choices: Choices | None = None) -> tuple[bytes, Account]:
    key = Key(b"x")
    account = Account()
    draft = RewritePlan(octets, account)
    made = rules.Rules(key, AddressMap(key), choices or Choices())
    made.parts(draft, [Part(part_layout, octets, 0, len(octets))])
    new = bytearray(len(octets))
    for begin, end, piece in draft.pieces:
        new[begin:end] = octets[begin:end] if piece is None else piece
    return bytes(new), account


def test_octets_without_a_meaning_become_zeros() -> None:
    new, account = treated(OCTETS, b"nobody knows")
    assert new == bytes(12)
    assert account.masked == {"unknown_octets": (1, 12)}


def test_a_password_becomes_zeros() -> None:
    new, account = treated(ENCODED_PASSWORD, b"\x26\x30\x12\x34\x56\x78\x9a\xbc")
    assert new == bytes(8)
    assert "passwords" in account.masked


def test_a_part_that_was_cut_keeps_whole_fields_only() -> None:
    octets = b"\x00\x01" + b"6ES7 315-2EH14-0AB0 " + b"\x00"
    new, _ = treated(IDENTIFICATION, octets)
    assert new == octets[:-1] + b"\0"
    new, account = treated(IDENTIFICATION, octets[:10])
    assert new == octets[:2] + bytes(8)
    assert account.masked == {"unknown_octets": (1, 8)}


def test_an_order_number_that_is_none_becomes_zeros() -> None:
    octets = b"\x00\x01" + b"\xff\x01secret!" + bytes(11) + bytes(6)
    assert treated(IDENTIFICATION, octets)[0] == b"\x00\x01" + bytes(26)


def test_addresses_in_a_content_are_mapped_as_those_of_packets() -> None:
    octets = bytes.fromhex("0800 c0a80007 ffffff00 c0a80001 001b1b123456 00 00".replace(" ", "")) + bytes(26)
    new, account = treated(ETHERNET, octets)
    addresses = AddressMap(Key(b"x"))
    assert new[2:6] == addresses.ip(octets[2:6]) != octets[2:6]
    assert new[6:10] == octets[6:10]
    assert new[14:20] == addresses.mac(octets[14:20]) != octets[14:20]
    assert account.replaced == {"content_addresses": 3}


def test_values_are_kept_when_asked_for_and_that_is_told() -> None:
    new, account = treated(CONTENT, b"\x01\x02\x03\x04", Choices(KEEP))
    assert new == b"\x01\x02\x03\x04"
    assert account.kept == {"values": 1}


def test_the_request_of_a_read_that_comes_again_stays_as_it_did() -> None:
    """What is remembered of a read is neither taken for a write nor for a read with something behind it."""
    key = Key(b"x")
    made, account = rules.Rules(key, AddressMap(key), Choices()), Account()
    item = build_item(0x04, 1, 10, 0x84, 32)
    read = build_variables(JOB, READ_VAR, 1, item)
    write = build_variables(JOB, WRITE_VAR, 1, item, build_data_item(0, 4, b"\x12\x34"))
    with_more = build_pdu(JOB, read[10:], b"more")
    for reference in (b"\0\1", b"\0\2"):
        assert plan_tsdu(with_reference(read, reference), made, account).pieces == [(0, len(read), None)]
        assert account.as_dict() == Account().as_dict()
        assert len(made.known) == 1
    for other in (write, with_more, read + b"x"):
        pieces = plan_tsdu(other, made, account).pieces
        assert pieces[-1][1] < len(other), "the octets behind the read are not known to tell nothing"
    assert len(made.known) == 1
    assert {kind: size for kind, (_, size) in account.masked.items()} == {"values": 2, "unknown_octets": 5}
