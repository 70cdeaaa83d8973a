"""S7comm-plus made anonymous: the same structure to the last byte, the same meaning, and nothing of the plant."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

import dissect
from dissect.engine.transactions.transaction import Transaction
from dissect.files.anonymize.account import KEEP, MASK, SCRAMBLE, Account, Choices
from dissect.files.anonymize.key import Key
from dissect.files.anonymize.plus_contents import PROCESS, PlusContents
from dissect.protocols.s7plus.assembly import MAX_PDU
from dissect.protocols.s7plus.contents import Contents, VariableAddress
from dissect.protocols.s7plus.layouts import VALUE
from dissect.protocols.s7plus.message import PlusPdu, parse_plus
from dissect.protocols.s7plus.objects import Attribute, PlusObject, build_object, every_object
from dissect.protocols.s7plus.tables import (
    CREATE_OBJECT,
    EXPLORE,
    GET_MULTI_VARIABLES,
    SET_MULTI_VARIABLES,
    SET_VARIABLE,
)
from dissect.protocols.s7plus.value_reading import read_value
from dissect.protocols.s7plus.value_tables import (
    ADDRESS_ARRAY,
    BLOB,
    DINT,
    REAL,
    RID,
    STRUCT,
    UDINT,
    USINT,
    WSTRING,
)  # fmt: skip
from dissect.protocols.s7plus.values import Blob, Packed, Rows, Struct, Value, build_value
from dissect.protocols.s7plus.variables import NameList, TagDescription
from dissect.protocols.s7plus.walk import Walk
from tests.files.anonymize.support import anonymized, told
from tests.files.anonymize.test_all import surviving_texts
from tests.meaning.report.support import begun, saved
from tests.properties.messages import dt
from tests.properties.packets import Talk
from tests.protocols.s7plus import bodies
from tests.protocols.s7plus.pdus import KEEP_ALIVE, asked, event, framed, notified
from tests.protocols.s7plus.pdus import told as answered
from tests.protocols.s7plus.strategies import OBJECTS, VALUES
from tests.protocols.s7plus.test_program import type_of, variable
from tests.protocols.s7plus.test_shared_captures import broken_integrity_ids, pdus

#: Texts that all plants have in common.
COMMON: Final = {b"LOGOUT", b"SIMATIC-ROOT-ES"}
TAG: Final = VariableAddress(0x1234ABCD, 0x8A0E0003, 2550, [14])
#: How a declaration calls DInt.
_DINT: Final = 7


def contents(values: str = MASK, keep_code: bool = False) -> tuple[PlusContents, Account]:
    account = Account()
    return PlusContents(Key(b"a key of these tests"), Choices(values, keep_code), account), account


def replaced(value: Value, about: int, values: str = MASK, keep_code: bool = False) -> Value:
    """Give what becomes of a value; it has to be read to its end, and to be as long."""
    octets = build_value(value)
    new = octets[:2] + contents(values, keep_code)[0].value(octets[2:], value.flags, value.type, about)
    assert len(new) == len(octets)
    walk = Walk(new, 0, len(new), False)
    found = read_value(walk, VALUE, 0)
    assert walk.left == 0
    return found


# ---- values ---------------------------------------------------------------------------------------------------------


@given(
    value=VALUES,
    about=st.sampled_from([PROCESS, 233, 304, 299, 1048, 2533, 9999]),
    values=st.sampled_from([MASK, SCRAMBLE]),
)
def test_any_value_becomes_one_of_the_same_structure(value: Value, about: int, values: str) -> None:
    found = replaced(value, about, values)
    assert (found.flags, found.type) == (value.flags, value.type)
    if isinstance(value.content, list):
        assert isinstance(found.content, list)
        assert len(found.content) == len(value.content)


@given(value=VALUES)
def test_values_of_the_process_stay_when_they_are_to(value: Value) -> None:
    if value.type != STRUCT:
        assert build_value(replaced(value, PROCESS, KEEP)) == build_value(value)


@pytest.mark.parametrize(
    ("value", "about", "new"),
    [
        (Value(0, DINT, -1234567), PROCESS, "least"),
        (Value(0, REAL, 21.5), PROCESS, 0.0),
        (Value(0, WSTRING, "Rührwerk"), PROCESS, "\0" * 9),
        (Value(0x10, USINT, [5, 4, 65, 66]), PROCESS, [0, 0, 0, 0]),
        (Value(0, UDINT, 2), 299, 2),  # the role of a client
        (Value(0, DINT, 1), 2167, 1),  # STOP
        (Value(0, UDINT, 77), 9999, 0),  # an attribute nobody knows
        (Value(0, RID, 0x8A0E0001), 9999, 0x8A0E0001),
        (Value(0, WSTRING, "1;6ES7 215-1AG40-0XB0 ;V4.3"), 319, "1;.... ...-.....-.... ;V4.3"),
        (Value(0, WSTRING, "PUMPWERK-7"), 298, "........-."),
        (Value(0x10, USINT, [1, 2, 3]), 304, [0, 0, 0]),  # the answer to a challenge
    ],
)  # fmt: skip
def test_what_becomes_of_a_value(value: Value, about: int, new: object) -> None:
    found = replaced(value, about).content
    if new == "least":
        assert found == 1 << 20  # the smallest number that takes as many bytes
    elif isinstance(new, str) and "." in new:
        assert isinstance(found, str)
        assert found != value.content
        assert [(a, b) for a, b in zip(found, new, strict=True) if b not in {a, "."}] == []
    else:
        assert found == new


def test_blobs_become_zeros_but_for_what_is_asked_to_stay() -> None:
    blob = Value(0, BLOB, Blob(0, b"zlib, a certificate"))
    for about, keep_code, stays in ((2533, True, True), (2533, False, False), (2546, True, False), (1805, True, False)):
        found = replaced(blob, about, keep_code=keep_code).content
        assert isinstance(found, Blob)
        assert found.octets == (b"zlib, a certificate" if stays else bytes(19))


def test_an_identification_record_keeps_its_form() -> None:
    record = (
        bytes.fromhex("002000380100002a")
        + b"6ES7 215-1AG40-0XB0 "
        + b"S C-H4U72345    "
        + bytes.fromhex("00055604030100000000ffff00000000")[:16]
    )
    found = replaced(Value(0, BLOB, Blob(0, record)), 3753).content
    assert isinstance(found, Blob)
    assert found.octets[:8] + found.octets[44:] == record[:8] + record[44:]
    assert b"6ES7 215" not in found.octets
    assert b"H4U72345" not in found.octets


def test_a_reference_list_keeps_what_is_subscribed_and_renames_its_checksums() -> None:
    listed = [
        0x80010000,
        1,
        2,
        77,
        0x80150002,
        4,
        48,
        52,
        0,
        2237,
        3486,
        0x80040002,
        5,
        9,
        0x8A0E0003,
        0x1234ABCD,
        2550,
        14,
    ]
    found = replaced(Value(ADDRESS_ARRAY, UDINT, list(listed)), 1048).content
    assert isinstance(found, list)
    crc = contents()[0].crc(0x1234ABCD)
    assert crc != 0x1234ABCD
    assert found == [crc if number == 0x1234ABCD else number for number in listed]


# ---- messages -------------------------------------------------------------------------------------------------------


def written(
    tmp_path: Path, talk: Talk, choices: Choices | None = None, largest: int = MAX_PDU
) -> tuple[Path, Path, Account]:
    source, out = saved(tmp_path / "source.pcapng", talk.packets()), tmp_path / "out.pcapng"
    return source, out, anonymized(source, out, choices, largest=largest)


def layouts_of(path: Path) -> list[tuple[str, str, list[tuple[str, int]]]]:
    return [
        (pdu.kind, pdu.function_name, [(part.layout.name, part.end) for part in found.parts])
        for pdu, found in pdus(path, cut=True)  # where a segment is lost, also in the source
    ]


def sent(talk: Talk, side: int, *octets: bytes) -> None:
    for one in octets:
        talk.send(side, dt(one))


def plant() -> Talk:
    """A client that says who it is, gets names and values, writes, and is told values by number."""
    talk = begun()
    session = PlusObject(211, 287, 0, 0, 0, [
        Attribute(233, Value(0, WSTRING, "SitzungNord")), Attribute(298, Value(0, WSTRING, "LEITWARTE-PC")),
        Attribute(299, Value(0, UDINT, 2)), Attribute(301, Value(0, WSTRING, "OMSP.REL.1")),
    ])  # fmt: skip
    sent(talk, 0, framed(asked(1, CREATE_OBJECT, 288, 0x36, bodies.create_object(285, Value(0, UDINT, 0), session)), 1))
    sent(talk, 1, framed(answered(1, CREATE_OBJECT, b"\0\1" + bodies.number(0x386) + bodies.FILL), 1))
    info = type_of(0x92000003, ("Fuellstand", variable(14, _DINT, crc=0x1234ABCD)))
    sent(talk, 0, framed(asked(2, EXPLORE, body=bodies.rid(0x8A0E0003) + b"\0\1\1\0\0\0" + bodies.end(5)), 3))
    sent(talk, 1, framed(answered(2, EXPLORE, b"\0" + bodies.rid(0x8A0E0003) + b"\7" + build(info) + bodies.FILL), 3))
    sent(talk, 0, framed(asked(3, GET_MULTI_VARIABLES, body=bodies.get_multi(TAG)), 3))
    sent(talk, 1, framed(answered(3, body=bodies.multi_got([(1, Value(0, DINT, 7654321))], [], 12)), 3))
    sent(talk, 0, framed(asked(4, SET_MULTI_VARIABLES, body=bodies.set_multi([(TAG, Value(0, DINT, 7654321))])), 3))
    sent(talk, 1, framed(answered(4, SET_MULTI_VARIABLES, b"\0\0" + bodies.end(13)), 3))
    sent(talk, 0, framed(asked(5, SET_VARIABLE, body=bodies.set_variable(52, [2167], Value(0, DINT, 1))), 3))
    sent(talk, 1, framed(answered(5, SET_VARIABLE, b"\0" + bodies.end(14)), 3))
    sent(talk, 1, KEEP_ALIVE, event(4711, b"LOGOUT"), event(4712, b"Pumpwerk"))
    return talk.close()


def build(one: PlusObject) -> bytes:
    return build_object(one)


def test_a_conversation_keeps_its_meaning(tmp_path: Path) -> None:
    source, out, account = written(tmp_path, plant())
    assert told(out) == told(source)
    assert layouts_of(out) == layouts_of(source)
    before, after = (dissect.analyze(str(path)) for path in (source, out))
    assert [finding.slug for finding in after.findings] == [finding.slug for finding in before.findings]
    assert {finding.slug for finding in after.findings} >= {"security.plc_stop", "security.write"}
    octets = out.read_bytes()
    for secret in (
        b"SitzungNord",
        b"LEITWARTE-PC",
        b"OMSP.REL",
        b"Fuellstand",
        b"Pumpwerk",
        b"\x5a" * 32,
        TAG.crc.to_bytes(4, "big"),
    ):
        assert secret not in octets
    assert bodies.number(TAG.crc) not in octets
    assert build_value(Value(0, DINT, 7654321)) not in octets
    assert b"LOGOUT" in octets
    assert account.replaced["names"] == 4
    labels = [
        item.label
        for event in dissect.open(str(out), pdus=False)
        if isinstance(event, Transaction)
        for item in event.plus_results
        if item.label.startswith("DB3.")
    ]
    assert len(labels) == 2
    assert len(set(labels)) == 1  # renamed, the same everywhere: its checksum fits that of its declaration


def test_the_same_name_becomes_the_same_in_every_capture(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    first = written(tmp_path / "a", plant())[1].read_bytes()
    second = written(tmp_path, plant())[1].read_bytes()
    assert first == second


@pytest.mark.parametrize(("version", "size"), [(3, 40), (3, 61), (3, 333), (2, 40), (1, 61)])
def test_a_pdu_in_many_frames(tmp_path: Path, version: int, size: int) -> None:
    """Names run across frames; a keep-alive and an empty frame stand between two of them."""
    one = PlusObject(
        211,
        511,
        0,
        0,
        0,
        [
            Attribute(233, Value(0, WSTRING, "Pumpwerk Nord " * 60)),
            Attribute(2546, Value(0, BLOB, Blob(0, b"Kommentar" * 50))),
        ],
    )
    id_ = b"\7" if version == 3 else b""
    body = answered(2, EXPLORE, b"\0" + bodies.rid(1) + id_ + build(one) + bodies.FILL)
    pieces = [body[at : at + size] for at in range(0, len(body), size)]
    talk = begun()
    end = bodies.end(-1 if version == 1 else 5)
    sent(talk, 0, framed(asked(2, EXPLORE, body=bodies.rid(1) + b"\0\1\1\0\0\0" + end), version))
    between = [KEEP_ALIVE, event(9), framed(b"", version, trailer=False)]
    for number, piece in enumerate(pieces, 1):
        sent(talk, 1, framed(piece, version, trailer=number == len(pieces)), *(between if number == 2 else []))
    source, out, _ = written(tmp_path, talk.close())
    assert layouts_of(out) == layouts_of(source)
    assert surviving_texts(source, out) == []
    assert b"Nord" not in out.read_bytes()


def test_what_cannot_be_read_becomes_zeros_and_is_paired_as_before(tmp_path: Path) -> None:
    talk = begun()
    sent(talk, 0, framed(asked(1, body=bodies.get_multi(TAG)), 3))
    sent(talk, 1, framed(answered(1, body=b"\0\1\0\x15\x7fPumpwerk"), 3))  # a text that is shorter than its length
    sent(talk, 0, framed(asked(2, EXPLORE, body=b"Pumpwerk 1"), 3, trailer=False))  # interrupted by the next one
    sent(talk, 0, framed(asked(3, body=bodies.get_multi(TAG)), 3))
    sent(talk, 0, framed(asked(4, EXPLORE, body=b"Pumpwerk 2"), 3, trailer=False))  # never ends
    sent(talk, 1, framed(notified() + b"\x92\0\0\0\1Pumpwerk", 3))
    source, out, _ = written(tmp_path, talk.close())
    assert told(out) == told(source)
    assert b"Pumpwerk" not in out.read_bytes()


def test_frames_of_a_lost_segment_become_zeros(tmp_path: Path) -> None:
    talk = begun()
    sent(talk, 0, framed(asked(2, EXPLORE, body=b"Pumpwerk 1"), 3, trailer=False))
    talk.skip(0, 100)
    sent(talk, 0, framed(b"Pumpwerk 2", 3), framed(asked(3, body=bodies.get_multi(TAG)), 3))
    source, out, _ = written(tmp_path, talk.close())
    assert b"Pumpwerk" not in out.read_bytes()
    assert [row[1] for row in layouts_of(out)] == [row[1] for row in layouts_of(source)]


def test_a_pdu_beyond_what_is_kept(tmp_path: Path) -> None:
    talk = begun()
    for number in range(8):
        body = asked(2, EXPLORE) if number == 0 else b""
        sent(talk, 0, framed(body + b"Pumpwerk Nord" * 30, 3, trailer=number == 7))
    sent(talk, 0, framed(asked(3, body=bodies.get_multi(TAG)), 3))
    _, out, _ = written(tmp_path, talk.close(), largest=2000)
    assert b"Nord" not in out.read_bytes()
    assert MAX_PDU == 8 << 20
    assert layouts_of_last(out) == "GetMultiVariables"


def layouts_of_last(path: Path) -> str:
    last = [event for event in dissect.open(str(path), pdus=False) if isinstance(event, Transaction)][-1]
    return last.function_name.removeprefix("S7comm-plus ")


@given(one=OBJECTS)
def test_any_object_keeps_its_structure(one: PlusObject) -> None:
    from dissect.files.anonymize.plus import PlusRules

    made, account = contents()
    octets = framed(
        asked(1, CREATE_OBJECT, 288, 0x36, bodies.create_object(285, Value(0, UDINT, 0), one, integrity_id=3)), 3
    )
    new = PlusRules(made, account).message(octets, None)  # type: ignore[arg-type]  # only answers and notifications look at it
    assert new is not None
    before, after = parts_of(octets), parts_of(new)
    assert [(part.layout.name, part.end) for part in after.parts] == [
        (part.layout.name, part.end) for part in before.parts
    ]
    assert after.malformed == []


def parts_of(octets: bytes) -> Contents:
    from dissect.protocols.s7plus.bodies import parse_contents

    return parse_contents(parse_plus(octets))


# ---- shared captures ------------------------------------------------------------------------------------------------


def shared(corpus: Path) -> list[Path]:
    return [*sorted((corpus / "s7plus").glob("*.pcap*")), *sorted(corpus.glob("s7comm*plus*.pcap"))]


def test_shared_captures(corpus: Path, tmp_path: Path) -> None:
    """Every part of every PDU in its place, ids that fit, the same findings; and no text, name, blob or digest is left."""
    paths = shared(corpus)
    assert len(paths) > 10
    for source in paths:
        out = tmp_path / "out.pcapng"
        account = anonymized(source, out, Choices(keep_others=True))
        assert account.dropped == {}
        before, after = pdus(source), pdus(out)
        assert [shape(*one) for one in after] == [shape(*one) for one in before], source.name
        assert [found.malformed for _, found in after] == [[] for _ in before], source.name
        assert broken_integrity_ids(after) == broken_integrity_ids(before), source.name
        assert findings(out) == findings(source), source.name
        octets = out.read_bytes()
        assert [secret for secret in secrets_of(before) if secret in octets] == [], source.name
        assert set(surviving_texts(source, out)) <= COMMON, source.name
        out.unlink()


def shape(pdu: PlusPdu, found: Contents) -> tuple[object, ...]:
    parts = [(part.layout.name, part.end) for part in found.parts]
    return pdu.version, pdu.kind, pdu.function, pdu.sequence, pdu.return_value, found.integrity_id, parts


def findings(path: Path) -> Counter[str]:
    """Count findings by slug. A byte outside of any message becomes zero, and is like a keep-alive probe then."""
    return Counter(finding.slug for finding in dissect.analyze(str(path)).findings if finding.slug != "session.idle")


def secrets_of(found: list[tuple[PlusPdu, Contents]]) -> set[bytes]:
    """Gather texts, names, blobs and digests of PDUs, as they were parsed; short and even ones happen by chance."""
    secrets: set[bytes] = set()
    for pdu, one in found:
        secrets |= {pdu.integrity, one.digest}
        for value in [one.value, *[value for _, value in one.items], *[value for _, value in one.list]]:
            secrets.update(leaves(value))
        for each in every_object(one.objects):
            for element in each.elements:
                if isinstance(element, Attribute):
                    secrets.update(leaves(element.value))
                elif isinstance(element, NameList):
                    secrets.update(name.encode() for name in element.names)
                elif isinstance(element, TagDescription):
                    secrets.add(element.name.encode())
    return {secret for secret in secrets if len(secret) >= 5 and len(set(secret)) > 2}


def leaves(thing: object) -> Iterator[bytes]:
    if isinstance(thing, str):
        yield thing.encode()
    elif isinstance(thing, bytes):
        yield thing
    elif isinstance(thing, (Blob, Packed)):
        yield thing.octets
        yield from leaves(thing.members if isinstance(thing, Blob) else [])
    elif isinstance(thing, Value):
        yield from leaves(thing.content)
    elif isinstance(thing, Struct):
        yield from leaves(thing.members)
    elif isinstance(thing, Rows):
        yield from leaves(thing.rows)
    elif isinstance(thing, (list, tuple)):
        for one in thing:
            yield from leaves(one)
