"""Items joined with what became of them: areas of a DBREAD, pushes of subscriptions, variables of test functions."""

from __future__ import annotations

import struct

import pytest

from dissect.engine.findings.reporter import Finding
from dissect.engine.transactions.results import (
    ALIKE,
    DATA,
    GAPS,
    HEADER,
    ITEM,
    NO_CODE,
    NO_CODE_TEXTS,
    UNCHANGED,
    SentAgain,
    TransactionError,
    item_error,
)
from dissect.engine.transactions.subscriptions import MAX_JOBS, follow
from dissect.engine.transactions.transaction import Transaction
from tests.cases import each
from tests.engine.findings import events
from tests.engine.transactions.talk import Talk, ack_data, dbw, head, item, job, read, userdata, write

#: Two areas: DB68 from octet 352 on two octets, DB72 octet 48.
AREAS = bytes.fromhex("120cb002020044016001004800 30")
CYCLIC, TEST = 2, 1
TRANSFER, UNSUBSCRIBE, ON_CHANGE, MODIFY = 1, 4, 5, 7
REQUEST, RESPONSE, PUSH = 1, 2, 0

Row = tuple[str, int, str | None]


def rows(transaction: Transaction) -> list[Row]:
    return [
        (
            result.item.label if result.item is not None else "?",
            result.return_code,
            result.data.hex() if result.data is not None else None,
        )
        for result in transaction.s7_results
    ]


def exchange(asked: bytes, told: bytes | None) -> Transaction:
    talk = Talk()
    talk.open()
    talk.ask(asked)
    if told is not None:
        talk.tell(told)
    talk.finish()
    return talk.transactions[-1]


def content(octets: bytes, code: int = 0xFF) -> bytes:
    return struct.pack(">BBH", code, 9, len(octets)) + octets


def payload(octets: bytes) -> bytes:
    return content(octets)


# ---- DBREAD ---------------------------------------------------------------------------------------------------------


def dbread(*answers: bytes) -> Transaction:
    return exchange(read(1, AREAS), ack_data(1, b"\x04\x01", b"".join(answers)))


def test_each_area_has_its_return_code_and_its_octets() -> None:
    transaction = dbread(content(bytes.fromhex("ff0001ff7a")))
    assert rows(transaction) == [("DB68.DBB352 x2", 0xFF, "0001"), ("DB72.DBB48", 0xFF, "7a")]
    assert [result.value for result in transaction.s7_results] == [[0, 1], 0x7A]
    assert (transaction._flags, transaction.has_errors, transaction.errors) == (0, False, [])


def test_an_area_that_is_refused_is_an_item_that_is_refused() -> None:
    transaction = dbread(content(bytes.fromhex("0aff7a")))
    assert rows(transaction) == [("DB68.DBB352 x2", 0x0A, None), ("DB72.DBB48", 0xFF, "7a")]
    assert transaction.has_errors
    assert [(error.where, error.code, error.address) for error in transaction.errors] == [
        ("item 1", 0x0A, "DB68.DBB352")
    ]


@pytest.mark.parametrize("octets", ["ff0001ff", "ff0001ff7a00", "ff0001", "00", ""])
def test_areas_that_do_not_fill_the_item_are_left_as_they_are(octets: str) -> None:
    transaction = dbread(content(bytes.fromhex(octets)))
    assert rows(transaction) == [("DB68.DBB352 x2+DB72.DBB48", 0xFF, octets)]
    assert transaction.s7_results[0].value is None
    assert [finding.slug for finding in transaction_findings(octets)] == ["transaction.size_mismatch"]


def transaction_findings(octets: str) -> list[Finding]:
    talk = Talk()
    talk.open()
    talk.ask(read(1, AREAS))
    talk.tell(ack_data(1, b"\x04\x01", content(bytes.fromhex(octets))))
    talk.finish()
    return list(talk.findings)


def test_an_item_refused_as_a_whole_stays_one() -> None:
    assert rows(dbread(b"\x05\0\0\0")) == [("DB68.DBB352 x2+DB72.DBB48", 0x05, None)]


def test_without_an_answer_each_area_is_named() -> None:
    assert rows(exchange(read(1, AREAS), None)) == [("DB68.DBB352 x2", -1, None), ("DB72.DBB48", -1, None)]


def test_areas_beside_other_items() -> None:
    asked = read(1, dbw(1, 0), AREAS, dbw(1, 2))
    told = b"\xff\x04\x00\x10\x00\x07" + content(bytes.fromhex("ff0001ff7a")) + b"\x00" + b"\x0a\0\0\0"
    transaction = exchange(asked, ack_data(1, b"\x04\x03", told))
    assert rows(transaction) == [
        ("DB1.DBW0", 0xFF, "0007"),
        ("DB68.DBB352 x2", 0xFF, "0001"),
        ("DB72.DBB48", 0xFF, "7a"),
        ("DB1.DBW2", 0x0A, None),
    ]
    assert [error.where for error in transaction.errors] == ["item 4"]


# ---- subscriptions --------------------------------------------------------------------------------------------------


def subscribe(reference: int, subfunction: int, *items: bytes, sequence: int = 0) -> bytes:
    said = bytes((0, len(items), 1, 2)) + b"".join(items)
    return userdata(reference, head(REQUEST, CYCLIC, subfunction, sequence), payload(said))


def sent(kind: int, subfunction: int, number: int, *values: bytes, reference: int = 0) -> bytes:
    said = bytes((0, len(values))) + b"".join(values)
    return userdata(reference, head(kind, CYCLIC, subfunction, number, 0), payload(said))


@pytest.fixture
def talk() -> Talk:
    """One who subscribed to two areas on change, as job 3."""
    talk = Talk()
    talk.open(8, 8)
    talk.ask(subscribe(1, ON_CHANGE, AREAS))
    talk.tell(sent(RESPONSE, ON_CHANGE, 3, content(bytes.fromhex("ff0001ff7a")), reference=1))
    return talk


def test_the_answer_holds_the_first_values(talk: Talk) -> None:
    assert rows(talk.transactions[-1]) == [("DB68.DBB352 x2", 0xFF, "0001"), ("DB72.DBB48", 0xFF, "7a")]


def test_a_push_tells_what_changed_and_what_did_not(talk: Talk) -> None:
    talk.tell(sent(PUSH, ON_CHANGE, 3, content(bytes.fromhex("feff7b"))))
    push = talk.transactions[-1]
    assert rows(push) == [("DB68.DBB352 x2", UNCHANGED, None), ("DB72.DBB48", 0xFF, "7b")]
    assert [result.unchanged for result in push.s7_results] == [True, False]
    assert (push.has_errors, push.errors) == (False, [])


def test_an_area_that_is_gone_is_an_error_of_the_push(talk: Talk) -> None:
    talk.tell(sent(PUSH, ON_CHANGE, 3, content(bytes.fromhex("0aff7b"))))
    push = talk.transactions[-1]
    assert push.has_errors
    assert [(error.where, error.code) for error in push.errors] == [("item 1", 0x0A)]


def test_a_modification_replaces_the_items_of_its_job(talk: Talk) -> None:
    talk.ask(subscribe(2, MODIFY, dbw(9, 4), sequence=3))
    talk.tell(sent(RESPONSE, MODIFY, 3, b"\xff\x04\x00\x10\x00\x07", reference=2))
    talk.tell(sent(PUSH, MODIFY, 3, b"\xff\x04\x00\x10\x00\x08"))
    assert [rows(one) for one in talk.transactions[-2:]] == [
        [("DB9.DBW4", 0xFF, "0007")],
        [("DB9.DBW4", 0xFF, "0008")],
    ]


def test_items_of_any_syntax_come_as_in_a_read() -> None:
    talk = Talk()
    talk.open(8, 8)
    talk.ask(subscribe(1, TRANSFER, dbw(1, 0), item(0x83, 0, 8, 2, 3), dbw(2, 0)))
    values = b"\xff\x04\x00\x10\x00\x07", b"\xff\x04\x00\x18abc\x00", b"\x0a\0\0\0"
    talk.tell(sent(RESPONSE, TRANSFER, 1, *values, reference=1), sent(PUSH, TRANSFER, 1, *values))
    wanted = [("DB1.DBW0", 0xFF, "0007"), ("MB1 x3", 0xFF, "616263"), ("DB2.DBW0", 0x0A, None)]
    assert [rows(one) for one in talk.transactions[-2:]] == [wanted, wanted]


def test_the_length_of_a_refused_item_hides_nothing_behind_it() -> None:
    """As in a read: nothing follows a return code that is no success, whatever the length says."""
    talk = Talk()
    talk.open(8, 8)
    talk.ask(subscribe(1, TRANSFER, dbw(1, 0), dbw(2, 0)))
    talk.tell(sent(RESPONSE, TRANSFER, 1, b"\x0a\x04\x00\x10", b"\xff\x04\x00\x10\x00\x07", reference=1))
    assert rows(talk.transactions[-1]) == [("DB1.DBW0", 0x0A, None), ("DB2.DBW0", 0xFF, "0007")]


def test_of_a_push_whose_subscription_is_not_known_the_values_stand_alone() -> None:
    talk = Talk()
    talk.open(8, 8)
    talk.tell(sent(PUSH, TRANSFER, 9, b"\xff\x04\x00\x10\x00\x07"))
    assert rows(talk.transactions[-1]) == [("?", 0xFF, "0007")]
    assert talk.transactions[-1].subscribed is None


def test_a_refused_subscription_subscribes_nothing(talk: Talk) -> None:
    talk.ask(subscribe(2, ON_CHANGE, dbw(9, 4)))
    talk.tell(userdata(2, head(RESPONSE, CYCLIC, ON_CHANGE, 4, 0x8104)))
    talk.tell(sent(PUSH, ON_CHANGE, 4, b"\xff\x04\x00\x10\x00\x07"))
    assert rows(talk.transactions[-1])[0][0] == "?"


def test_jobs_that_are_remembered_are_bounded() -> None:
    talk = Talk()
    talk.open(8, 8)
    for number in range(MAX_JOBS + 3):
        talk.ask(subscribe(number, TRANSFER, dbw(1, 0)))
        talk.tell(sent(RESPONSE, TRANSFER, number, b"\xff\x04\x00\x10\x00\x07", reference=number))
    jobs = talk.transactions[-1].connection.subscriptions
    assert len(jobs) == MAX_JOBS
    talk.tell(sent(PUSH, TRANSFER, 2, b"\xff\x04\x00\x10\x00\x07"))
    assert rows(talk.transactions[-1])[0][0] == "?"
    talk.tell(sent(PUSH, TRANSFER, 3, b"\xff\x04\x00\x10\x00\x07"))
    assert rows(talk.transactions[-1])[0][0] == "DB1.DBW0"


@each("cut", range(1, 30))
def test_what_is_cut_never_raises(talk: Talk, cut: int) -> None:
    whole = sent(PUSH, ON_CHANGE, 3, content(bytes.fromhex("ff0002ff7b")))
    talk.tell(whole[:-cut])
    talk.tell(whole)
    assert rows(talk.transactions[-1])[0] == ("DB68.DBB352 x2", 0xFF, "0002")


# ---- test functions -------------------------------------------------------------------------------------------------

#: MD0, I8.1, T5 and two words of DB10.
VARIABLES = [bytes.fromhex(text) for text in ("030100000000", "100100000008", "540100000005", "7202000a0004")]


def asked_by_test(reference: int, subfunction: int, variables: list[bytes], values: bytes = b"") -> bytes:
    data = struct.pack(">H", len(variables)) + b"".join(variables) + values
    said = struct.pack(">HH", 20, len(data)) + bytes(20) + data
    return userdata(reference, head(REQUEST, TEST, subfunction), payload(said))


def pushed_by_test(subfunction: int, number: int, data: bytes) -> bytes:
    said = struct.pack(">HH", 4, len(data)) + bytes(4) + data
    return userdata(0, head(PUSH, TEST, subfunction, number, 0), payload(said))


@pytest.mark.parametrize("subfunction", [8, 9])
def test_what_is_modified_or_forced_to_which_value(subfunction: int) -> None:
    values = b"\x00\x09\x00\x04\x41\x33\x85\x1f" + b"\x00\x03\x00\x01\x01\x00"
    talk = Talk()
    talk.open(8, 8)
    talk.ask(asked_by_test(1, subfunction, VARIABLES[:2], values))
    talk.tell(userdata(1, head(RESPONSE, TEST, subfunction, 2, 0)))
    forced = talk.transactions[-1]
    assert rows(forced) == [("MD0", -1, "4133851f"), ("I8.1", -1, "01")]
    assert [result.value for result in forced.s7_results] == [0x4133851F, True]
    (finding,) = [finding for finding in talk.findings if finding.slug == "security.force"]
    assert "MD0 = 1093895455, I8.1 = true" in finding.detail
    talk.tell(pushed_by_test(subfunction, 2, b"\x00\x02\xff\x05"))
    assert rows(talk.transactions[-1]) == [("MD0", 0xFF, None), ("I8.1", 0x05, None)]
    assert [error.address for error in talk.transactions[-1].errors] == ["I8.1"]


def test_what_is_watched_comes_with_its_values() -> None:
    talk = Talk()
    talk.open(8, 8)
    talk.ask(asked_by_test(1, 2, VARIABLES[1:]))
    talk.tell(userdata(1, head(RESPONSE, TEST, 2, 2, 0)))
    values = b"\xff\x03\x00\x01\x01\x00" + b"\xff\x09\x00\x02\x01\x23" + b"\xff\x09\x00\x04\0\1\0\2"
    talk.tell(pushed_by_test(2, 2, b"\x00\x03" + values))
    assert rows(talk.transactions[-2]) == [("I8.1", -1, None), ("T5", -1, None), ("DB10.DBW4 x2", -1, None)]
    assert [result.value for result in talk.transactions[-1].s7_results] == [True, "S5T#1s230ms", [1, 2]]


# ---- writes ---------------------------------------------------------------------------------------------------------


def test_a_write_whose_answer_lacks_return_codes_is_not_called_written() -> None:
    values = b"\x00\x04\x00\x10\x00\x01" * 3
    asked = write(1, [dbw(1, 0), dbw(1, 2), dbw(1, 4)], values)
    transaction = exchange(asked, ack_data(1, b"\x05\x01", b"\xff"))
    assert rows(transaction) == [("DB1.DBW0", 0xFF, "0001"), ("DB1.DBW2", -1, "0001"), ("DB1.DBW4", -1, "0001")]
    assert transaction.has_errors
    assert [(error.where, error.code, error.name, error.address) for error in transaction.errors] == [
        ("item 2", -1, "No return code", "DB1.DBW2"),
        ("item 3", -1, "No return code", "DB1.DBW4"),
    ]
    assert transaction.errors[0].as_dict()["code"] is None


def test_what_a_broken_request_asks_for_is_not_the_fault_of_the_answer() -> None:
    """Not 'asked for -1 items, answered 1'."""
    talk = Talk()
    talk.open()
    talk.ask(job(1, b"\x04"))
    talk.tell(ack_data(1, b"\x04\x01", b"\xff\x04\x00\x10\x00\x01"))
    assert talk.slugs() == ["s7.malformed"]


# ---- acknowledgements of alarms -------------------------------------------------------------------------------------

ALARM_ACK, ALARM_LOCK = 0x0B, 7
ACKNOWLEDGE = bytes.fromhex("0902 1208190060000001 0101 1208190060000002 0001")


def acknowledged(codes: str, subfunction: int = ALARM_ACK, asked: bytes = ACKNOWLEDGE) -> Transaction:
    told = head(RESPONSE, 4, subfunction, 1, 0)
    return exchange(
        userdata(7, head(REQUEST, 4, subfunction), content(asked)), userdata(7, told, content(bytes.fromhex(codes)))
    )


@each(
    ("codes", "refused"),
    [
        ("0902 ffff", []),
        ("0902 0aff", [("alarm 1", "0x0a Object does not exist", "event 0x60000001")]),
        ("0902 ff03", [("alarm 2", "0x03 Access not allowed", "event 0x60000002")]),
        ("0903 ffff05", [("alarm 3", "0x05 Invalid address", "")]),
        ("0902 ff", []),
        ("0900", []),
        ("09", []),
        ("", []),
    ],
)
def test_each_alarm_has_a_return_code(codes: str, refused: list[tuple[str, str, str]]) -> None:
    transaction = acknowledged(codes)
    assert transaction.has_errors is bool(refused)
    assert [(error.where, error.coded, error.address) for error in transaction.errors] == refused


def test_a_lock_names_its_alarms_as_well() -> None:
    transaction = acknowledged("0901 0a", ALARM_LOCK, bytes.fromhex("0901 1206150060000003"))
    assert [error.address for error in transaction.errors] == ["event 0x60000003"]


def test_alarms_that_are_cut_short_name_no_event() -> None:
    for size in range(len(ACKNOWLEDGE)):
        transaction = acknowledged("0902 0a0a", ALARM_ACK, ACKNOWLEDGE[:size])
        known = ["event 0x60000001" if size >= 10 else "", "event 0x60000002" if size >= 20 else ""]
        assert [error.address for error in transaction.errors] == known, size


def test_an_alarm_of_an_unknown_form_is_not_misread() -> None:
    """Its event id may stand elsewhere: the refusal is told by its number alone."""
    transaction = acknowledged("0902 0a0a", ALARM_ACK, ACKNOWLEDGE.replace(b"\x19", b"\x7f"))
    assert [(error.where, error.address) for error in transaction.errors] == [("alarm 1", ""), ("alarm 2", "")]


def test_an_answer_of_which_the_request_is_missing_is_refused_as_well() -> None:
    talk = Talk()
    talk.open()
    talk.tell(userdata(7, head(RESPONSE, 4, ALARM_ACK, 1, 0), content(bytes.fromhex("0901 0a"))))
    talk.finish()
    assert [(error.where, error.address) for error in talk.transactions[-1].errors] == [("alarm 1", "")]


@pytest.mark.parametrize(("flag", "doubt"), [(GAPS, "gaps"), (ALIKE, "alike")])
def test_pushes_of_a_subscription_that_is_only_likely_are_only_likely_themselves(flag: int, doubt: str) -> None:
    """The job exists, as its pushes show, but which items it sends is only likely."""
    talk = Talk()
    talk.open()
    talk.ask(events.asks(1, CYCLIC, TRANSFER, events.CYCLIC))
    talk.tell(events.tells(1, CYCLIC, TRANSFER, events.CYCLIC_VALUES, sequence=5))
    subscribed = talk.transactions[-1]
    jobs = subscribed.connection.subscriptions
    assert len(jobs) == 1
    talk.tell(events.pushes(CYCLIC, TRANSFER, events.CYCLIC_VALUES, sequence=5))
    sure = talk.transactions[-1]
    assert (sure.certainty, sure.doubt) == ("", "")
    subscribed._flags |= flag
    follow(subscribed)
    talk.tell(events.pushes(CYCLIC, TRANSFER, events.CYCLIC_VALUES, sequence=5))
    push = talk.transactions[-1]
    assert (push.certainty, push.doubt, push.is_likely) == ("likely", doubt, False)  # it is no pair
    assert [result.item and result.item.label for result in push.s7_results] == [
        result.item and result.item.label for result in sure.s7_results
    ]
    subscribed._flags &= ~flag
    follow(subscribed)
    talk.tell(events.pushes(CYCLIC, TRANSFER, events.CYCLIC_VALUES, sequence=5))
    assert talk.transactions[-1].certainty == ""


# ---- jobs -----------------------------------------------------------------------------------------------------------


def watched(number: int = 2) -> Talk:
    """A client that watches a variable as test job 4, and values cyclically as job 5."""
    talk = Talk()
    talk.open(8, 8)
    talk.ask(asked_by_test(1, 2, VARIABLES[:1]))
    talk.tell(userdata(1, head(RESPONSE, TEST, 2, 4, 0)))
    talk.ask(subscribe(2, TRANSFER, dbw(1, 0)))
    talk.tell(sent(RESPONSE, TRANSFER, 5, b"\xff\x04\x00\x10\x00\x07", reference=2))
    return talk


@pytest.mark.parametrize(
    ("group", "subfunction", "known"),
    [(TEST, 0x12, False), (TEST, 0x0E, True), (TEST, 0x0F, True), (4, 0x12, True), (4, 1, True)],
)
def test_a_replaced_test_job_has_other_items(group: int, subfunction: int, known: bool) -> None:
    """Enabled or deleted it has those of its request, and other groups and cyclic jobs have nothing to do with it."""
    talk = watched()
    talk.ask(userdata(3, head(REQUEST, group, subfunction), payload(bytes(8))))
    talk.tell(userdata(3, head(RESPONSE, group, subfunction, 9, 0)))
    talk.tell(pushed_by_test(2, 4, b"\x00\x01\xff\x09\x00\x04\0\0\0\1"))
    talk.tell(sent(PUSH, TRANSFER, 5, b"\xff\x04\x00\x10\x00\x08"))
    assert [rows(one)[0][0] for one in talk.transactions[-2:]] == ["MD0" if known else "?", "DB1.DBW0"]


def test_jobs_of_the_two_sides_are_apart() -> None:
    """Both may ask, and both number their jobs."""
    talk = watched()
    talk.tell(asked_by_test(7, 2, VARIABLES[1:2]))
    talk.ask(userdata(7, head(RESPONSE, TEST, 2, 4, 0)))
    jobs = talk.transactions[-1].connection.subscriptions.values()
    assert [job.items[0].address for job in jobs] == ["MD0", "DB1.DBW0", "I8.1"]
    talk.tell(userdata(8, head(REQUEST, TEST, 0x12), payload(bytes(8))))  # the server replaces its job
    talk.ask(userdata(8, head(RESPONSE, TEST, 0x12, 9, 0)))
    talk.tell(pushed_by_test(2, 4, b"\x00\x01\xff\x09\x00\x04\0\0\0\1"))
    assert rows(talk.transactions[-1]) == [("MD0", 0xFF, "00000001")]
    jobs = talk.transactions[-1].connection.subscriptions.values()
    assert [job.items[0].address for job in jobs] == ["MD0", "DB1.DBW0"]


def test_test_jobs_of_different_functions_may_have_one_number() -> None:
    talk = watched()
    talk.ask(asked_by_test(3, 9, VARIABLES[1:2], b"\x00\x03\x00\x01\x01\x00"))
    talk.tell(userdata(3, head(RESPONSE, TEST, 9, 4, 0)))
    talk.tell(pushed_by_test(2, 4, b"\x00\x01\xff\x09\x00\x04\0\0\0\1"))
    talk.tell(pushed_by_test(9, 4, b"\x00\x01\xff"))
    assert [rows(one) for one in talk.transactions[-2:]] == [[("MD0", 0xFF, "00000001")], [("I8.1", 0xFF, None)]]


def test_a_subscription_shows_its_function_and_its_items() -> None:
    talk = watched()
    (first, second) = talk.transactions[-1].connection.subscriptions.values()
    assert repr(first) == f"Subscription({first.head.name}: MD0)"
    assert repr(second) == f"Subscription({second.head.name}: DB1.DBW0)"
    assert (first.written, second.written) == ([], [])
    talk.ask(asked_by_test(3, 9, VARIABLES[:2], b"\x00\x09\x00\x04\x41\x33\x85\x1f" + b"\x00\x03\x00\x01\x01\x00"))
    talk.tell(userdata(3, head(RESPONSE, TEST, 9, 4, 0)))
    forced = [*talk.transactions[-1].connection.subscriptions.values()][-1]
    assert [one.data.hex() for one in forced.written] == ["4133851f", "01"]


@each("size", range(12))
def test_a_push_or_answer_that_is_cut_short_has_its_items_without_values(size: int) -> None:
    """A payload of fewer octets than its counts need."""
    talk = watched()
    whole = struct.pack(">HH", 4, 10) + bytes(4) + b"\x00\x01\xff\x09\x00\x04\0\0\0\1"
    talk.tell(userdata(0, head(PUSH, TEST, 2, 4, 0), payload(whole[:size])))
    assert rows(talk.transactions[-1]) == [("MD0", -1, None)]
    said = bytes((0, 1)) + b"\xff\x04\x00\x10\x00\x08"
    talk.tell(userdata(0, head(PUSH, CYCLIC, TRANSFER, 5, 0), payload(said[:size])))
    cyclic = rows(talk.transactions[-1])
    assert cyclic == [("DB1.DBW0", 0xFF, "0008")] if size >= 8 else cyclic[0][0] == "DB1.DBW0"


# ---- refusals in words ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("error", "text", "shown", "coded", "code"),
    [
        (
            item_error(10, 3, "DB2.DBB400"),
            "item 3 DB2.DBB400: Object does not exist",
            "'item 3', 0xa",
            "0x0a Object does not exist",
            10,
        ),
        (item_error(10, 3, ""), "item 3: Object does not exist", "'item 3', 0xa", "0x0a Object does not exist", 10),
        (
            TransactionError(HEADER, 0x8104, "Wrong", "It is."),
            "header: Wrong",
            "'header', 0x8104",
            "0x8104 Wrong",
            0x8104,
        ),
        (TransactionError(DATA, 5, "Wrong", "It is."), "data: Wrong", "'data', 0x5", "0x05 Wrong", 5),
        (
            TransactionError(ITEM, NO_CODE, *NO_CODE_TEXTS, 2),
            "item 2: No return code",
            "'item 2', 0x-1",
            "No return code",
            None,
        ),
        (TransactionError(HEADER, 1, "a\x1bb", ""), "header: a\\x1bb", "'header', 0x1", "0x0001 a\x1bb", 1),
    ],
)
def test_a_refusal_in_words(error: TransactionError, text: str, shown: str, coded: str, code: int | None) -> None:
    assert (str(error), error.coded) == (text, coded)
    assert repr(error) == f"TransactionError({shown}, {error.name!r})"
    assert error.as_dict() == {"where": error.where, "code": code, "name": error.name, "text": error.text}


def test_an_item_that_is_only_known_by_its_number_is_named_once() -> None:
    assert str(item_error(3, 7, "item 7")) == "item 7: Access not allowed"


@pytest.mark.parametrize(
    ("times", "text"), [(1, "request sent again after 300 ms"), (2, "request sent again 2 times, last after 300 ms")]
)
def test_a_request_sent_again_in_words(times: int, text: str) -> None:
    again = SentAgain()
    assert (again.times, again.frame, again.time_ns) == (0, 0, 0)
    again.times, again.time_ns = times, 300_000_007
    assert again.text(7) == text
