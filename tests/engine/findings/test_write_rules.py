"""Writes as events of security: what became of each item decides what is said; and how findings name items and values."""

from __future__ import annotations

import struct

import pytest

from dissect.engine.transactions.naming import subject
from dissect.protocols.s7.tables import REAL
from tests.cases import each
from tests.engine.findings import events
from tests.engine.transactions.talk import (
    CLIENT,
    RST,
    SERVER,
    SYN,
    Talk,
    ack,
    ack_data,
    dbw,
    head,
    item,
    read,
    setup,
    userdata,
    write,
    written,
)

QB0 = item(0x82, 0, 0, 2)
MB8 = item(0x83, 0, 8 * 8, 2, 4)
MB0 = item(0x83, 0, 0, 2)
BOTH = write(1, [QB0, MB8], written(4, b"\xff") + b"\0" + written(4, b"\x42\x34\0\0"))
WHO = "10.0.0.1:50000 to 10.0.0.2:102: "


def set_up() -> Talk:
    talk = Talk()
    talk.open()
    return talk


def said(talk: Talk, *slugs: str) -> list[tuple[str, str]]:
    """The findings about writes, without who did it."""
    talk.pipeline.exchange.report_findings()
    wanted = slugs or ("security.write", "security.new_writer")
    return [
        (finding.slug, finding.detail.removeprefix(WHO)) for finding in talk.findings if finding.slug.startswith(wanted)
    ]


OUTPUT = "Write Var QB0 = 255"
FLAGS = "Write Var MB8 x4 = 42 34 00 00"


@pytest.mark.parametrize(
    ("answer", "expected"),
    [
        (
            ack_data(1, b"\x05\x02", b"\xff\xff"),
            [("security.write_outputs", OUTPUT), ("security.write", FLAGS)],
        ),
        (
            ack_data(1, b"\x05\x02", b"\x03\xff"),
            [
                ("security.write", FLAGS),
                ("security.write_refused", f"{OUTPUT}, refused: 0x03 Access not allowed"),
            ],
        ),
        (
            ack_data(1, b"\x05\x02", b"\xff\x0a"),
            [
                ("security.write_outputs", OUTPUT),
                ("security.write_refused", f"{FLAGS}, refused: 0x0a Object does not exist"),
            ],
        ),
        (
            ack_data(1, b"\x05\x02", b"\x03\x0a"),
            [
                (
                    "security.write_refused",
                    f"{OUTPUT}, MB8 x4 = 42 34 00 00, refused: 0x03 Access not allowed, 0x0a Object does not exist",
                )
            ],
        ),
        (
            ack(1, 0x8404),
            [
                (
                    "security.write_refused",
                    "Write Var QB0 = 255, MB8 x4 = 42 34 00 00, refused: 0x8404 Function cannot be performed",
                )
            ],
        ),
        (
            ack_data(1, b"\x05\x02", b"\xff"),
            [("security.write_outputs", OUTPUT), ("security.write", f"{FLAGS}, without a return code")],
        ),
    ],
)
def test_each_item_is_judged_by_its_own_code(answer: bytes, expected: list[tuple[str, str]]) -> None:
    talk = set_up()
    talk.ask(BOTH)
    talk.tell(answer)
    assert said(talk) == expected


@pytest.mark.parametrize("again", [0, 2])
def test_a_write_of_which_some_items_have_no_code_is_one_write(again: int) -> None:
    """However many items of one kind of area it has, and whatever is known of them; so are further ones."""
    talk = set_up()
    for number in range(1 + again):
        items = [item(0x84, 1, 8 * at, 2) for at in range(3)]
        talk.ask(write(1 + number, items, b"".join([written(4, b"\7") + b"\0" for _ in items[1:]]) + written(4, b"\7")))
        talk.tell(ack_data(1 + number, b"\x05\x03", b"\xff"))
    talk.pipeline.exchange.report_findings()
    assert said(talk) == [
        (
            "security.write",
            "Write Var DB1.DBB0 = 7, DB1.DBB1 = 7, DB1.DBB2 = 7, without a return code",
        )
    ]
    assert talk.pipeline.exchange.reporter.ledger.rules["security.write"].events == 1 + again


def test_what_was_not_answered_is_told_and_hides_nothing() -> None:
    talk = set_up()
    for value in (b"\1", b"\2"):
        talk.ask(write(1, [QB0], written(4, value)))  # the reference is used again, which gives up the first one
    talk.tell(ack_data(1, b"\x05\x01", b"\xff"))
    talk.close()
    assert said(talk) == [
        ("security.write_outputs", "Write Var QB0 = 1, not answered"),
        ("security.write_outputs", "Write Var QB0 = 2"),
    ]


def test_a_write_that_was_answered_before_is_not_told_again() -> None:
    talk = set_up()
    talk.ask(write(2, [QB0], written(4, b"\2")))
    talk.tell(ack_data(2, b"\x05\x01", b"\xff"))
    talk.ask(write(3, [QB0], written(4, b"\3")))
    talk.packet(SERVER, flags=RST)
    talk.finish()
    assert said(talk) == [("security.write_outputs", "Write Var QB0 = 2")]


def test_where_only_the_client_was_captured() -> None:
    """Nobody knows whether it was answered, and nothing says that it was not."""
    talk = Talk()
    talk.packet(CLIENT, flags=SYN)
    talk.packet(CLIENT)
    for reference in range(10):
        talk.ask(write(reference, [QB0], written(4, b"\xff")))
    talk.ask(events.stop(99))
    talk.finish()
    assert said(talk, "security.") == [
        ("security.write_outputs", "Write Var QB0 = 255, answer not captured"),
        ("security.plc_stop", "PLC stop, answer not captured"),
    ]


def test_who_was_refused_or_not_answered_is_no_writer() -> None:
    talk = set_up()
    talk.ask(write(1, [MB0], written(4, b"\1")))
    talk.tell(ack_data(1, b"\x05\x01", b"\x0a"))
    talk.ask(write(1, [MB0], written(4, b"\1")))
    second = Talk(client_port=50001, beside=talk)
    second.hosts = [9, 2]
    second.open()
    second.ask(write(1, [MB0], written(4, b"\1")))
    second.tell(ack_data(1, b"\x05\x01", b"\xff"))
    talk.finish()
    assert [slug for slug, _ in said(talk)] == ["security.write_refused", "security.write", "security.write"]


def test_0x8104_may_be_protection_and_the_codes_of_protection_are() -> None:
    for code, expected in (
        (0x8104, "Read Var DB1.DBW0 x3 (protected, or not supported), refused: 0x8104 "),
        (0xD241, "Read Var DB1.DBW0 x3, refused: 0xd241 "),
    ):
        talk = set_up()
        talk.ask(read(1, dbw(1, 0, 3)))
        talk.tell(ack(1, code))
        ((_, detail),) = said(talk, "security.protected")
        assert detail.startswith(expected), detail


@each(
    ("code", "name", "perhaps"),
    [
        (0x8181, "application relationship (error class 0x81)", True),
        (0x8104, "Service not implemented or frame error", True),
        (0x82FF, "object definition (error class 0x82)", True),
        (0x8304, "no resources (error class 0x83)", True),
        (0x8404, "Function cannot be performed", True),
        (0x8500, "Wrong PDU size or frame", True),
        (0x8702, "Service not supported by module", False),
        (0xD209, "Block not found", False),
        (0x8003, "state of the module (error class 0x80)", False),
    ],
)
def test_classes_that_may_be_protection(code: int, name: str, perhaps: bool) -> None:
    """Of reads and writes only; and every finding about the refusal names it alike."""
    for request in (read(1, dbw(1, 0)), write(1, [dbw(1, 0)], written(4, b"\0\1"))):
        talk = set_up()
        talk.ask(request)
        talk.tell(ack(1, code))
        talk.pipeline.exchange.report_findings()
        details = [finding.detail for finding in talk.findings]
        assert all(detail.endswith(f" 0x{code:04x} {name}") for detail in details)
        protected = [finding.detail for finding in talk.findings if finding.slug == "security.protected"]
        assert len(protected) == perhaps
        assert all("(protected, or not supported)" in detail for detail in protected)
    for request in (setup(1), events.stop(1), userdata(1, head(1, 3, 1))):
        talk = set_up()
        talk.ask(request)
        talk.tell(ack(1, code))
        talk.pipeline.exchange.report_findings()
        assert "security.protected" not in talk.slugs()


@pytest.mark.parametrize(
    ("where", "size", "octets", "named"),
    [
        (dbw(1, 4, 3), 4, b"\0\1\0\2\0\3", "DB1.DBW4 x3 = [1, 2, 3]"),
        (dbw(1, 4, 20), 4, bytes(40), "DB1.DBW4 x20 = [0, 0, 0, 0, 0, 0, 0, 0, …]"),
        (item(0x84, 1, 0, 2, 10), 4, bytes(10), "DB1.DBB0 x10 = 00 00 00 00 00 00 00 00 …"),
        (item(0x84, 1, 0, 2), 4, b"\7", "DB1.DBB0 = 7"),
        (item(0x84, 1, 3, 1), 3, b"\1", "DB1.DBX0.3 = true"),
        (item(0x84, 1, 0, REAL), 7, struct.pack(">f", 2.5), "DB1.DBD0 = 2.5"),
        (item(0x84, 1, 0, 3, 40), 9, b"x" * 40, f"DB1.DBB0 x40 = '{'x' * 32}…'"),
        (dbw(1, 4), 4, b"\0", "DB1.DBW4 = 00"),
    ],
)
def test_an_item_is_named_with_its_length_and_a_short_value(where: bytes, size: int, octets: bytes, named: str) -> None:
    talk = set_up()
    talk.ask(write(1, [where], written(size, octets)))
    talk.tell(ack_data(1, b"\x05\x01", b"\x0a"))
    assert subject(talk.transactions[0]) == f"Write Var {named}"
    assert said(talk, "transaction.item_error") == [
        ("transaction.item_error", f"Write Var {named}: 0x0a Object does not exist")
    ]


def test_a_read_is_named_with_its_lengths() -> None:
    talk = set_up()
    talk.ask(read(1, dbw(1, 4, 3), dbw(1, 0), dbw(1, 0), dbw(1, 0)))
    talk.tell(ack(1, 0x8404))
    ((_, detail),) = said(talk, "transaction.refused")
    assert detail.startswith("Read Var DB1.DBW4 x3, DB1.DBW0, DB1.DBW0 and 1 more: 0x8404")


def test_a_password_without_an_answer_says_so_once() -> None:
    talk = set_up()
    talk.ask(events.asks(1, 5, 1, events.PASSWORD))
    talk.packet(SERVER, flags=RST)
    talk.finish()
    assert said(talk, "security.password") == [("security.password", "password, not answered")]


def test_which_inquiry_makes_it_a_reconnaissance() -> None:
    for lists, said_of_it in (
        ((0x0011, 0x001C, 0x0111), "third inquiry: CPU functions: read SZL"),
        (range(0x0121, 0x0121 + 20), "10th list: CPU functions: read SZL"),
    ):
        talk = set_up()
        for pdu_ref, szl_id in enumerate(lists, 1):
            talk.ask(events.szl(pdu_ref, szl_id))
            talk.tell(events.no_szl(pdu_ref))
        ((_, detail),) = said(talk, "security.reconnaissance")
        assert detail.startswith(said_of_it)


def test_a_refused_write_hides_no_later_one() -> None:
    talk = set_up()
    for reference, code in enumerate((b"\x03", b"\x03", b"\xff", b"\xff"), 1):
        talk.ask(write(reference, [QB0], written(4, b"\x01")))
        talk.tell(ack_data(reference, b"\x05\x01", code))
    assert [slug for slug, _ in said(talk)] == ["security.write_refused", "security.write_outputs"]


@pytest.mark.parametrize(
    ("stated", "slug", "why"),
    [
        (1, "transaction.count_mismatch", ": requested 2 items, got 1"),
        (2, "s7.malformed", ": s7: return codes at byte 14: 2 announced, 1 there"),
    ],
)
def test_an_item_without_a_return_code_was_not_refused(stated: int, slug: str, why: str) -> None:
    """That the answer is too short is told once, and the transaction has failed: nobody knows what became of the item."""
    talk = set_up()
    talk.ask(BOTH)
    talk.tell(ack_data(1, bytes((5, stated)), b"\xff"))
    ((found, detail),) = said(talk, "transaction.", "s7.malformed")
    assert found == slug
    assert detail.endswith(f"Write Var QB0 = 255, MB8 x4 = 42 34 00 00{why}")
    (transaction,) = talk.transactions
    assert transaction.failed
    assert [(error.where, error.name) for error in transaction.errors] == [("item 2", "No return code")]
