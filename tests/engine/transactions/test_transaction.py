from __future__ import annotations

import struct

import pytest

from dissect.engine.transactions import results as checks
from dissect.engine.transactions import transaction as module
from dissect.engine.transactions.results import (
    ALIKE,
    BEHIND,
    COUNT_MISMATCH,
    EXPECTED,
    FUNCTION_MISMATCH,
    GAPS,
    HEADER,
    ITEM,
    MESSAGE,
    PARAMETER,
    REORDERED,
    SIZE_MISMATCH,
    STILL_OPEN,
    UNCONFIRMED,
    half_captured,
    mismatches,
    went_wrong,
)
from dissect.engine.transactions.transaction import (
    ANSWERED,
    BEHIND_MALFORMED,
    CONNECTION_CLOSED,
    HOLE,
    LIKELY,
    MALFORMED_HEADER,
    ONE_SIDED,
    OPEN,
    ORPHAN,
    OUTCOMES,
    PERHAPS_ANSWERED,
    PUSH,
    REASON_TEXTS,
    SURE,
    UNANSWERED,
    Transaction,
    unasked,
)
from dissect.meaning.report.facets import subject
from dissect.protocols.s7.items import ItemResult
from dissect.protocols.s7.parameters import parse_parameters
from dissect.protocols.s7.values import Value
from tests.engine.transactions.talk import (
    Talk,
    ack,
    ack_data,
    dbw,
    good,
    granted,
    head,
    item,
    job,
    read,
    refused,
    setup,
    userdata,
    words,
    write,
    written,
)
from tests.layers.examples import BY_NUMBER

#: Names of the bits of `Transaction._flags` that checks sets.
FLAGS = frozenset(
    [
        "FUNCTION_MISMATCH",
        "COUNT_MISMATCH",
        "SIZE_MISMATCH",
        "REORDERED",
        "BAD_DATA",
        "EXPECTED",
        "BAD_REQUEST",
        "WRITE_SIZE",
        "ODD_DATA_CODE",
        "NOT_LOADED",
        "STRAY_PUSH",
        "GAPS",
        "ALIKE",
        "ASKED_JUDGED",
    ]
)


def exchange(asked: bytes, told: bytes | None) -> Transaction:
    """The transaction of one request and its answer."""
    talk = Talk()
    talk.open(8, 8)
    talk.ask(asked)
    if told is not None:
        talk.tell(told)
    talk.close()
    assert len(talk.transactions) == 1
    return talk.transactions[0]


def example(asked: int, told: int) -> Transaction:
    return exchange(BY_NUMBER[asked].octets[7:], BY_NUMBER[told].octets[7:])


Row = tuple[str | None, int, str | None, Value]


def rows(transaction: Transaction) -> list[Row]:
    """Address, return code, octets and value of every result."""
    return [row(result) for result in transaction.s7_results]


def row(result: ItemResult) -> Row:
    return (
        result.item.address if result.item is not None else None,
        result.return_code,
        result.data.hex() if result.data is not None else None,
        result.value,
    )


@pytest.mark.parametrize(
    ("asked", "told", "results"),
    [
        (28, 29, [("DB10.DBW4", 0xFF, "001102200333", [0x11, 0x220, 0x333])]),
        (
            30,
            31,
            [
                ("M10.3", 0xFF, "01", True),
                ("DB7.DBB0", 0xFF, "a1b2c3", [0xA1, 0xB2, 0xC3]),
                ("DB7.DBD8", 0xFF, "42f6e979", 123.456),
            ],
        ),
        (
            32,
            33,
            [
                ("DB7.DBB0", 0xFF, "1234", [0x12, 0x34]),
                ("DB999.DBB0", 0x0A, None, None),
                ("T5", 0xFF, "10051006", ["S5T#500ms", "S5T#600ms"]),
            ],
        ),
        (
            34,
            35,
            [("DB1.DBD0", 0xFF, "fffffffe", -2), ("DB1.DBB10", 0xFF, "616263", "abc"), ("C5", 0xFF, "0123", 123)],
        ),
        (36, 37, [("DB68.DBB352", 0xFF, "0001", [0, 1]), ("DB72.DBB48", 0xFF, "7a", 0x7A)]),
        (40, 41, [("M2.0", 0xFF, "01", True)]),
        (42, 43, [("DB3.DBB5", 0xFF, "5a", 0x5A), ("DB3.DBW10", 0x05, "00640065", [100, 101])]),
    ],
)
def test_worked_examples(asked: int, told: int, results: list[Row]) -> None:
    transaction = example(asked, told)
    assert rows(transaction) == results
    assert transaction._flags == 0
    assert transaction.has_errors is any(result[1] != 0xFF for result in results)


THREE = [dbw(1, 0), dbw(1, 2), item(0x84, 1, 32, 8)]


@pytest.mark.parametrize(
    ("told", "results"),
    [
        # Fewer answers than items, and more.
        (
            ack_data(1, b"\x04\x01", good(4, b"\0\1")),
            [("DB1.DBW0", 0xFF, "0001", 1), ("DB1.DBW2", -1, None, None), ("DB1.DBD4", -1, None, None)],
        ),
        (
            ack_data(1, b"\x04\x04", good(4, b"\0\1") * 4),
            [
                ("DB1.DBW0", 0xFF, "0001", 1),
                ("DB1.DBW2", 0xFF, "0001", 1),
                ("DB1.DBD4", 0xFF, "0001", None),  # two octets are no REAL
                (None, 0xFF, "0001", None),
            ],
        ),
        # Data cut off within the second item: what is there is kept, and not taken for a value.
        (
            ack_data(1, b"\x04\x03", good(4, b"\0\1") + b"\xff\x04\x00\x10\x00"),
            [("DB1.DBW0", 0xFF, "0001", 1), ("DB1.DBW2", 0xFF, "00", None), ("DB1.DBD4", -1, None, None)],
        ),
        # Refused as a whole.
        (
            ack(1, 0x8104),
            [("DB1.DBW0", -1, None, None), ("DB1.DBW2", -1, None, None), ("DB1.DBD4", -1, None, None)],
        ),
        (
            ack_data(1, b"\x04\x03", b"", 0x8500),
            [("DB1.DBW0", -1, None, None), ("DB1.DBW2", -1, None, None), ("DB1.DBD4", -1, None, None)],
        ),
        # An answer to something else.
        (
            ack_data(1, b"\x05\x03", b"\xff\xff\xff"),
            [("DB1.DBW0", -1, None, None), ("DB1.DBW2", -1, None, None), ("DB1.DBD4", -1, None, None)],
        ),
        (None, [("DB1.DBW0", -1, None, None), ("DB1.DBW2", -1, None, None), ("DB1.DBD4", -1, None, None)]),
    ],
)
def test_a_read_and_an_answer_that_do_not_match(told: bytes | None, results: list[Row]) -> None:
    assert rows(exchange(read(1, *THREE), told)) == results


@pytest.mark.parametrize(
    ("data", "told", "results"),
    [
        (
            written(4, b"\0\1") + written(4, b"\0\2"),
            ack_data(1, b"\x05\x02", b"\xff\x05"),
            [("DB1.DBW0", 0xFF, "0001", 1), ("DB1.DBW2", 0x05, "0002", 2)],
        ),
        # Fewer codes than items, and more.
        (
            written(4, b"\0\1") + written(4, b"\0\2"),
            ack_data(1, b"\x05\x01", b"\xff"),
            [("DB1.DBW0", 0xFF, "0001", 1), ("DB1.DBW2", -1, "0002", 2)],
        ),
        (
            written(4, b"\0\1") + written(4, b"\0\2"),
            ack_data(1, b"\x05\x03", b"\xff\xff\x0a"),
            [("DB1.DBW0", 0xFF, "0001", 1), ("DB1.DBW2", 0xFF, "0002", 2), (None, 0x0A, None, None)],
        ),
        # Fewer values than items, and one of another size.
        (
            written(4, b"\0\1"),
            ack_data(1, b"\x05\x02", b"\xff\xff"),
            [("DB1.DBW0", 0xFF, "0001", 1), ("DB1.DBW2", 0xFF, None, None)],
        ),
        (
            written(4, b"\0\1\2\3") + written(4, b"\0\2"),
            ack_data(1, b"\x05\x02", b"\x07\xff"),
            [("DB1.DBW0", 0x07, "00010203", None), ("DB1.DBW2", 0xFF, "0002", 2)],
        ),
        # Refused as a whole, and not answered.
        (
            written(4, b"\0\1") + written(4, b"\0\2"),
            ack(1, 0x8104),
            [("DB1.DBW0", -1, "0001", 1), ("DB1.DBW2", -1, "0002", 2)],
        ),
        (
            written(4, b"\0\1") + written(4, b"\0\2"),
            None,
            [("DB1.DBW0", -1, "0001", 1), ("DB1.DBW2", -1, "0002", 2)],
        ),
    ],
)
def test_a_write_and_an_answer_that_do_not_match(data: bytes, told: bytes | None, results: list[Row]) -> None:
    assert rows(exchange(write(1, [dbw(1, 0), dbw(1, 2)], data), told)) == results


@pytest.mark.parametrize(
    ("octets", "value"),
    [(b"\1\0\1\0\1\0\1\0", [True, False] * 4), (b"\x55", None), (b"\1\0\1", None)],
)
def test_several_bits_are_values_only_with_an_octet_each(octets: bytes, value: Value) -> None:
    """Eight bits in one octet: nobody says in which order, so nothing is invented."""
    answer = ack_data(1, b"\x04\x01", b"\xff\x03\x00" + bytes((len(octets) * 8,)) + octets)
    if len(octets) == 1:
        answer = ack_data(1, b"\x04\x01", b"\xff\x03\x00\x08" + octets)
    transaction = exchange(read(1, item(0x83, 0, 0, 1, 8)), answer)
    assert rows(transaction) == [("M0.0", 0xFF, octets.hex(), value)]
    assert transaction._flags == 0


def test_a_data_record_shorter_than_asked_for_is_no_mismatch() -> None:
    transaction = exchange(read(1, item(0x01, 5, 0x200, 2, 240)), ack_data(1, b"\x04\x01", good(4, b"\1\2\3\4")))
    assert (transaction._flags, rows(transaction)) == (0, [("RECORD5@512", 0xFF, "01020304", [1, 2, 3, 4])])


@pytest.mark.parametrize(
    "asked", [setup(1), job(1, b"\x1d" + bytes(17)), job(1, b"\x29"), userdata(1, head(1, 4, 1)), job(1, b"")]
)
def test_other_functions_have_no_results(asked: bytes) -> None:
    assert exchange(asked, None).s7_results == []


# ---- errors ---------------------------------------------------------------------------------------------------------


def errors(transaction: Transaction) -> list[tuple[str, int, str, str]]:
    return [(error.where, error.code, error.name, error.address) for error in transaction.errors]


def test_the_place_of_an_error_is_data_and_a_word_for_people() -> None:
    answer = ack_data(1, b"\x04\x02", good(4, b"\0\1") + refused(0x0A))
    (error,) = exchange(read(1, dbw(1, 0), dbw(1, 2)), answer).errors
    assert (error.part, error.item, error.where, error.address) == (ITEM, 2, "item 2", "DB1.DBW2")
    (error,) = exchange(read(1, dbw(1, 0)), ack_data(1, b"", b"", 0x8104)).errors
    assert (error.part, error.item, error.where) == (HEADER, 0, "header")


def test_results_are_read_once() -> None:
    transaction = exchange(read(1, dbw(1, 0)), ack_data(1, b"\x04\x01", refused(0x0A)))
    assert transaction.s7_results is transaction.s7_results
    assert transaction.s7_results[0].return_code == 0x0A


def test_results_of_an_open_transaction_are_not_kept() -> None:
    talk = Talk()
    talk.open(8, 8)
    talk.ask(read(1, dbw(1, 0)))
    (waiting,) = talk.pipeline.table.all_open()[0].connection.open_requests[0].table.values()
    assert [result.return_code for result in waiting.s7_results] == [-1]
    talk.tell(words(1, 7))
    assert rows(talk.transactions[-1]) == [("DB1.DBW0", 0xFF, "0007", 7)]
    assert talk.transactions[-1] is waiting


def test_flags_are_bits_of_their_own() -> None:
    flags = [value for name, value in vars(checks).items() if name.isupper() and name in FLAGS]
    flags += [UNCONFIRMED, STILL_OPEN, BEHIND]
    assert len(flags) == len(FLAGS) + 3
    assert sum(flags) == (1 << len(flags)) - 1


def test_a_write_that_is_still_open_is_not_one_without_return_codes() -> None:
    talk = Talk()
    talk.open(8, 8)
    talk.ask(write(1, [dbw(1, 0)], written(4, b"\0\5")))
    talk.pipeline.finish()
    (transaction,) = talk.transactions
    assert (transaction.failed, subject(transaction)) == (False, "DB1.DBW0 = 5")


def test_errors_of_items_in_wire_order_with_place_and_address() -> None:
    items = [dbw(1, 0), dbw(1, 2), dbw(1, 4), item(0x1D, 0, 5, 0x1D)]
    answer = ack_data(1, b"\x04\x04", refused(0x0A) + good(4, b"\0\1") + refused(0x05) + refused(0x03))
    transaction = exchange(read(1, *items), answer)
    assert errors(transaction) == [
        ("item 1", 0x0A, "Object does not exist", "DB1.DBW0"),
        ("item 3", 0x05, "Invalid address", "DB1.DBW4"),
        ("item 4", 0x03, "Access not allowed", "T5"),
    ]
    assert all(error.text for error in transaction.errors)


def test_no_code_but_success_is_good() -> None:
    transaction = exchange(read(1, dbw(1, 0)), ack_data(1, b"\x04\x01", refused(0x00)))
    assert errors(transaction) == [("item 1", 0x00, "Reserved", "DB1.DBW0")]


def test_the_header_comes_before_the_items() -> None:
    transaction = exchange(read(1, dbw(1, 0)), ack_data(1, b"\x04\x01", refused(0x05), 0x8404))
    assert [error[:2] for error in errors(transaction)] == [("header", 0x8404), ("item 1", 0x05)]
    assert transaction.errors[0].as_dict() == {
        "where": "header",
        "code": 0x8404,
        "name": "Function cannot be performed",
        "text": "The partner could not carry out the function",
    }


def test_errors_of_a_write() -> None:
    transaction = exchange(
        write(1, [dbw(1, 0), dbw(1, 2)], written(4, b"\0\1") * 2), ack_data(1, b"\x05\x02", b"\x05\xff")
    )
    assert errors(transaction) == [("item 1", 0x05, "Invalid address", "DB1.DBW0")]


def test_errors_of_userdata_stand_in_the_parameters() -> None:
    transaction = exchange(userdata(1, head(1, 4, 1)), userdata(1, head(2, 4, 1, 0, 0xD402)))
    assert errors(transaction) == [("parameter", 0xD402, "Invalid SZL index", "")]


def test_a_return_code_of_userdata_is_no_error_by_itself() -> None:
    """0x0a is the everyday head of an answer without payload (reference 4.2)."""
    transaction = exchange(userdata(1, head(1, 7, 2)), userdata(1, head(2, 7, 2, 0, 0), b"\x0a\x00\x00\x00"))
    assert (transaction.has_errors, transaction.errors) == (False, [])


def test_codes_that_nobody_knows_name_themselves() -> None:
    transaction = exchange(read(1, dbw(1, 0)), ack_data(1, b"\x04\x01", refused(0x77), 0x1234))
    assert [error[2] for error in errors(transaction)] == ["0x1234", "0x77"]


# ---- the halves -----------------------------------------------------------------------------------------------------


def test_both_halves_are_pdus() -> None:
    transaction = exchange(read(1, dbw(1, 0)), words(1, 42))
    request, response = transaction.request, transaction.response
    assert request is not None
    assert response is not None
    assert (request.octets, request.frame, request.time_ns) == (
        read(1, dbw(1, 0)),
        transaction.request_frame,
        transaction.request_ns,
    )
    assert (response.octets, response.frame, response.side) == (words(1, 42), transaction.response_frame, 1)
    assert (request.connection, request.side) == (1, 0)
    assert transaction.latency_ns == response.time_ns - request.time_ns


def test_the_server_asks_and_the_client_answers() -> None:
    talk = Talk()
    talk.open()
    talk.tell(job(1, b"\x1b" + bytes(17)))
    talk.ask(ack_data(1, b"\x1b\x00", b"\x00\x02\x00\xfbpp"))
    request, response = talk.transactions[0].request, talk.transactions[0].response
    assert request is not None
    assert response is not None
    assert (request.side, response.side) == (1, 0)


def test_data_items_of_each_half() -> None:
    reading = exchange(read(1, dbw(1, 0)), words(1, 42))
    assert [one.data for one in reading._answered_items()] == [b"\x00\x2a"]
    assert reading._written_items() == []
    writing = exchange(write(1, [dbw(1, 0)], written(4, b"\0\1")), ack_data(1, b"\x05\x01", b"\xff"))
    assert [one.data for one in writing._written_items()] == [b"\0\1"]
    assert writing._answered_items() == []
    upload = exchange(job(1, b"\x1e\x01" + bytes(6), written(4, b"\0\1")), ack_data(1, b"\x1e\x01", good(4, b"\0\1")))
    assert (upload._answered_items(), upload._written_items()) == ([], [])


def test_a_half_that_is_missing() -> None:
    transaction = exchange(read(1, dbw(1, 0)), None)
    assert (transaction.response, transaction.response_octets, transaction.latency_ns) == (None, b"", None)
    assert transaction.request is not None


def test_the_packets_are_those_of_both_halves() -> None:
    both, half = exchange(read(1, dbw(1, 0)), words(1, 1)), exchange(read(1, dbw(1, 0)), None)
    assert both.frames == [both.request_frame, both.response_frame]
    assert both.request_frame < both.response_frame
    assert half.frames == [both.request_frame]
    orphan = lonely_answer()
    assert orphan.frames == [orphan.response_frame]


def lonely_answer() -> Transaction:
    talk = Talk()
    talk.open(8, 8)
    talk.tell(words(9, 1))
    talk.close()
    (orphan,) = talk.transactions
    return orphan


def test_the_parts_of_a_request_are_cut_once() -> None:
    transaction = exchange(job(1, b"\x1d" + bytes(17)), ack(1, 0xD209))
    assert transaction.request_body is not None
    assert transaction.request_body is transaction.request_body
    assert lonely_answer().request_body is None


def test_the_answer_is_timed_from_the_packet_that_completes_the_request() -> None:
    talk = Talk()
    talk.open()
    octets = struct.pack(">BBHBBB", 3, 0, 7 + len(read(1, dbw(1, 0))), 2, 0xF0, 0x80) + read(1, dbw(1, 0))
    talk.packet(0, octets[:9])
    talk.packet(0, octets[9:], after_ns=1000)
    answer = struct.pack(">BBHBBB", 3, 0, 7 + len(words(1, 1)), 2, 0xF0, 0x80) + words(1, 1)
    talk.packet(1, answer[:12], after_ns=100)
    talk.packet(1, answer[12:], after_ns=20)
    talk.close()
    assert [transaction.latency_ns for transaction in talk.transactions] == [120]


def test_names() -> None:
    transaction = exchange(read(1, dbw(1, 0)), words(1, 1))
    assert repr(transaction) == "Transaction(2, Read Var, answered)"
    assert [transaction.outcome, OUTCOMES[0]] == ["answered", "open"]
    assert exchange(userdata(1, head(1, 4, 1)), None).function_name == "CPU functions: read SZL"


def test_every_reason_has_its_sentence() -> None:
    reasons = {
        value
        for name, value in vars(module).items()
        if name.isupper() and isinstance(value, str) and name.lower() == value
    }
    reasons -= {HEADER, PARAMETER, ITEM, MESSAGE, SURE, LIKELY}  # parts of an answer and certainties, not reasons
    assert set(REASON_TEXTS) == reasons
    assert len(reasons) == 8
    assert all(text[0].islower() and not text.endswith(".") for text in REASON_TEXTS.values())


def test_granted_values_come_from_the_answer() -> None:
    transaction = exchange(setup(1, 8, 8, 960), granted(1, 2, 3, 240))
    answer = transaction.response_parameters
    assert transaction.parameters.setup is not None
    assert answer is not None
    assert answer.setup is not None
    assert (transaction.parameters.setup.pdu_length, answer.setup.pdu_length) == (960, 240)


def answered_read() -> Transaction:
    talk = Talk()
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(words(1, 42))
    talk.close()
    return talk.transactions[-1]


@pytest.mark.parametrize(("flag", "doubt"), [(GAPS, "gaps"), (ALIKE, "alike"), (GAPS | ALIKE, "gaps")])
def test_a_pair_that_is_only_likely_has_no_answer_time_and_no_mismatch(flag: int, doubt: str) -> None:
    found = answered_read()
    assert (found.certainty, found.doubt, found.is_likely, found.latency_ns) == (SURE, "", False, 1_000_000)
    found._flags |= checks.SIZE_MISMATCH
    assert (checks.mismatches(found), checks.went_wrong(found)) == (checks.SIZE_MISMATCH, True)
    found._flags |= flag
    assert (found.certainty, found.doubt, found.is_likely, found.latency_ns) == (LIKELY, doubt, True, None)
    assert (checks.mismatches(found), checks.went_wrong(found), found.failed) == (0, False, False)
    assert found.reason_text == ""
    found.has_errors = True  # what an answer refuses is refused, whichever request it belongs to
    assert checks.went_wrong(found)


def test_an_answer_that_was_not_captured_is_neither_missed_nor_failed() -> None:
    found = answered_read()
    found._outcome, found.reason = UNANSWERED, CONNECTION_CLOSED
    assert (found.certainty, found.missed, found.failed) == ("", True, True)
    assert found.reason_text == REASON_TEXTS[CONNECTION_CLOSED]
    found.reason = HOLE
    assert (found.certainty, found.missed, found.failed, found.unseen) == (SURE, False, False, True)
    assert found.reason_text == "answered, but the answer was not captured"
    found._flags |= GAPS
    assert (found.certainty, found.missed, found.failed, found.unseen) == (LIKELY, False, False, True)
    assert found.reason_text == "perhaps answered: bytes from the answering side are missing from the capture"
    assert (found.is_likely, found.doubt) == (False, "")  # it is no pair


def test_an_answer_without_a_request_is_no_pair() -> None:
    found = answered_read()
    found._outcome, found.reason = ORPHAN, HOLE
    assert (found.certainty, found.doubt, found.reason_text) == ("", "", "")


@pytest.mark.parametrize(
    ("told", "data"),
    [
        (ack_data(1, b"\x04\x01", good(4, b"\0\1")), b"\0\1"),
        (ack_data(1, b"\x05\x01", good(4, b"\0\1")), None),
        (ack_data(1, b"\x1f\x01", good(4, b"\0\1")), None),
        (ack(1, 0, b"\x04\x01") + good(4, b"\0\1"), None),
    ],
    ids=["the read", "a write", "end of upload", "an Ack"],
)
def test_data_that_look_like_those_of_a_read_are_items_only_in_its_answer(told: bytes, data: bytes | None) -> None:
    talk = Talk()
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(told)
    talk.close()
    (one,) = talk.transactions
    assert one.outcome == "answered"
    assert len(one._answered_items()) == (data is not None)
    assert [(result.data, result.return_code) for result in one.s7_results] == [
        (data, 0xFF if data is not None else -1)
    ]


# ---- what becomes of it, in every combination -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("outcome", "reason", "flags", "certainty", "doubt", "said"),
    [
        (OPEN, "", 0, "", "", ""),
        (OPEN, "", GAPS, "", "", ""),
        (ANSWERED, "", 0, SURE, "", ""),
        (ANSWERED, "", GAPS, LIKELY, "gaps", ""),
        (ANSWERED, "", ALIKE, LIKELY, "alike", ""),
        (ANSWERED, "", GAPS | ALIKE, LIKELY, "gaps", ""),
        (ANSWERED, MALFORMED_HEADER, 0, SURE, "", ""),
        (UNANSWERED, HOLE, 0, SURE, "", REASON_TEXTS[HOLE]),
        (UNANSWERED, HOLE, GAPS, LIKELY, "", PERHAPS_ANSWERED),
        (UNANSWERED, CONNECTION_CLOSED, 0, "", "", REASON_TEXTS[CONNECTION_CLOSED]),
        (UNANSWERED, CONNECTION_CLOSED, GAPS, "", "", REASON_TEXTS[CONNECTION_CLOSED]),
        (UNANSWERED, CONNECTION_CLOSED, STILL_OPEN, "", "", REASON_TEXTS[CONNECTION_CLOSED]),
        (UNANSWERED, ONE_SIDED, EXPECTED, "", "", REASON_TEXTS[ONE_SIDED]),
        (ORPHAN, HOLE, EXPECTED, "", "", ""),
        (ORPHAN, HOLE, ALIKE, "", "", ""),
        (PUSH, "", 0, "", "", ""),
        (PUSH, "", ALIKE, LIKELY, "alike", ""),
        (BEHIND_MALFORMED, MALFORMED_HEADER, BEHIND, "", "", REASON_TEXTS[MALFORMED_HEADER]),
    ],
)
@pytest.mark.parametrize("errors", [False, True])
def test_what_is_said_of_a_transaction(
    outcome: int, reason: str, flags: int, certainty: str, doubt: str, said: str, errors: bool
) -> None:
    one = exchange(read(1, dbw(1, 0)), words(1, 7))
    one._outcome, one.reason, one._flags, one.has_errors = outcome, reason, flags, errors
    assert (one.certainty, one.doubt, one.reason_text) == (certainty, doubt, said)
    assert one.is_likely is (outcome == ANSWERED and doubt != "")
    assert (one.latency_ns is not None) is (outcome == ANSWERED and not doubt)
    unseen = outcome == UNANSWERED and (reason == HOLE or flags == EXPECTED)
    assert (one.unseen, one.missed) == (unseen, outcome == UNANSWERED and not unseen and flags != STILL_OPEN)
    assert one.failed is (errors or one.missed)
    assert one.is_behind is (flags == BEHIND)
    assert went_wrong(one) is one.failed


@pytest.mark.parametrize("doubts", [0, GAPS, ALIKE])
@pytest.mark.parametrize("flags", [0, FUNCTION_MISMATCH, COUNT_MISMATCH | SIZE_MISMATCH, REORDERED])
def test_a_pair_that_is_only_likely_contradicts_nothing(flags: int, doubts: int) -> None:
    one = exchange(read(1, dbw(1, 0)), words(1, 7))
    one._flags = flags | doubts
    expected = 0 if doubts or flags == REORDERED else flags
    assert mismatches(one) == expected
    assert went_wrong(one) is (expected != 0)
    assert not half_captured(one)
    one._flags |= EXPECTED
    assert half_captured(one)


def test_three_errors_are_named() -> None:
    asked = read(1, *[dbw(1, 2 * number) for number in range(4)])
    one = exchange(asked, ack_data(1, b"\x04\x04", refused(10) + refused(5) + refused(3) + refused(10)))
    said = "Read Var DB1.DBW0, DB1.DBW2, DB1.DBW4 and 1 more: answered, "
    assert str(one) == f"{said}Object does not exist, Invalid address, Access not allowed"
    assert len(one.errors) == 4
    assert repr(one) == f"Transaction({one.number}, Read Var, answered)"


def test_octets_of_each_half_are_its_own_wherever_they_are() -> None:
    """Alone in their buffers, or between others."""
    one = exchange(read(1, dbw(1, 0)), words(1, 7))
    asked, told = read(1, dbw(1, 0)), words(1, 7)
    for before, after in ((b"", b""), (b"xy", b""), (b"", b"z"), (b"xy", b"z")):
        one._request_buf, one._request_offset, one.request_size = before + asked + after, len(before), len(asked)
        one._response_buf, one._response_offset, one.response_size = before + told + after, len(before), len(told)
        assert (one.request_octets, one.response_octets) == (asked, told)


def test_lines_of_json_need_a_later_room() -> None:
    one = exchange(read(1, dbw(1, 0)), words(1, 7))
    there = list(module.AS_DICT)
    module.AS_DICT.clear()
    try:
        with pytest.raises(RuntimeError, match=r"dissect\.files\.session"):
            one.as_dict()
    finally:
        module.AS_DICT.extend(there)


def test_a_whole_request_is_refused_by_an_error_code_or_by_the_code_of_its_data() -> None:
    refusals = [
        exchange(read(1, dbw(1, 0)), ack(1, 0x8104)),
        exchange(read(1, dbw(1, 0)), ack_data(1, b"\x04\x01", refused(10))),
        exchange(read(1, dbw(1, 0)), words(1, 7)),
        exchange(userdata(1, head(1, 4, 1)), userdata(1, head(2, 4, 1, 1, 0))),
    ]
    assert [one.refused for one in refusals] == [True, False, False, True]
    assert [one.has_errors for one in refusals] == [True, True, False, True]


@pytest.mark.parametrize("alone", [False, True])
def test_an_error_code_with_items_has_both(alone: bool) -> None:
    data = b"" if alone else good(4, b"\0\1")
    one = exchange(read(1, dbw(1, 0)), ack_data(1, b"\x04\x01", data, 0x8500))
    assert [result.data for result in one.s7_results] == [None if alone else b"\0\1"]
    assert [error.where for error in one.errors] == ["header"]


def test_nothing_is_known_of_a_transaction_at_first() -> None:
    """Packets and times are 0 for none, acknowledgements -1."""
    connection = exchange(read(1, dbw(1, 0)), words(1, 7)).connection
    one = Transaction(5, connection, 1, 1, 9, parse_parameters(b"\x04\x00", 1))
    numbers = "request_frame request_ns request_size response_frame response_ns response_size response_rosctr error_code _flags"
    assert [getattr(one, name) for name in numbers.split()] == [0] * 9
    assert (one.number, one.asked_by, one.rosctr, one.pdu_ref, one._request_ack, one._request_seq) == (
        5,
        1,
        1,
        9,
        -1,
        -1,
    )
    assert (one.outcome, one.reason, one.has_errors, one.again, one.subscribed) == ("open", "", False, None, None)
    assert (one.request, one.response, one.plus_request, one.plus_response, one.request_body) == (None,) * 5
    assert (one.request_octets, one.response_octets, one.frames, one.errors, one.items, one.scd) == (
        b"",
        b"",
        [],
        [],
        [],
        [],
    )
    answer = unasked(connection, 1, 3, 9, one.parameters, b"xyz", 1, 2, 7, 70)
    assert (answer.outcome, answer.number, answer.asked_by, answer.rosctr, answer.pdu_ref) == (
        "orphan_answer",
        0,
        1,
        3,
        9,
    )
    assert (answer.response_octets, answer.frames, answer.response_ns, answer.response_rosctr) == (b"yz", [7], 70, 3)
