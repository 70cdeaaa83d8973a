"""Userdata answers that refuse by the return code of their data, for every function, code and form; codes of refused reads."""

from __future__ import annotations

from typing import Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.engine.stations.evidence import Evidence
from dissect.engine.transactions.multipart import Joiner
from dissect.engine.transactions.refusals import read_codes
from dissect.engine.transactions.transaction import Transaction
from dissect.protocols.s7.message import NOT_REFUSED, parse_pdu
from dissect.protocols.s7.tables import DATA, RETURN_CODES, USERDATA_SUBFUNCTIONS
from tests import build
from tests.cases import each
from tests.engine.findings import events
from tests.engine.transactions.talk import Talk, ack, ack_data, head, item, read, userdata, write, written

REQUEST: Final = 1
RESPONSE: Final = 2
EMPTY: Final = build.payload(b"")
#: A payload without items or alarms, for the functions that count them.
PAYLOAD: Final = bytes(10)
PUSHES: Final = frozenset(("Push.",))

FUNCTIONS: Final = [
    (group, row.number) for group, table in USERDATA_SUBFUNCTIONS.items() for row in table if row.text not in PUSHES
]
#: What a good answer to these always has (reference 4.5 to 4.12): jobs, values, blocks, SZL records, alarms, the time.
RETURN_DATA: Final = {
    (1, 0x10), (2, 1), (2, 5), (2, 7), (2, 8), (3, 1), (3, 2), (3, 3), (4, 1), (4, 0x13), (7, 1), (7, 3),
}  # fmt: skip


def told(group: int, subfunction: int, code: int, content: bytes, error: int = 0, length: int | None = None) -> bytes:
    """An answer with this return code; ``length`` is what its data head states, by default what follows."""
    size = len(content) if length is None else length
    return userdata(1, head(RESPONSE, group, subfunction, 1, error), build.data_item(code, 9, content, size))


def exchanged(group: int, subfunction: int, answer: bytes) -> tuple[Talk, Transaction]:
    talk = Talk()
    talk.open()
    talk.ask(userdata(1, head(REQUEST, group, subfunction), EMPTY))
    talk.tell(answer)
    talk.pipeline.exchange.report_findings()
    (transaction,) = talk.transactions
    return talk, transaction


def test_what_returns_data_is_in_the_table() -> None:
    assert {
        (group, row.number) for group, table in USERDATA_SUBFUNCTIONS.items() for row in table if row.returns == DATA
    } == RETURN_DATA
    assert {row.returns for table in USERDATA_SUBFUNCTIONS.values() for row in table} == {"", DATA}
    assert USERDATA_SUBFUNCTIONS[4].returns(0x99) == ""


@each(
    ("group", "subfunction", "code", "content"),
    [
        (*function, code, content)
        for function in [*FUNCTIONS, (4, 0x7F), (9, 1)]  # also what no table has
        for code in (0xFF, 0x0A, 0x05, 0x00, 0x03, 0x81)
        for content in (b"", PAYLOAD)
    ],
)
def test_every_function_code_and_form(group: int, subfunction: int, code: int, content: bytes) -> None:
    """Refused: no payload, and a code other than success; 0x0a and 0x00 only where the answer should return data."""
    answer = told(group, subfunction, code, content)
    returns = (group, subfunction) in RETURN_DATA
    refused = not content and (code != 0xFF if returns else code not in {0xFF, 0x0A, 0x00})
    pdu = parse_pdu(answer)
    assert (pdu.refused, pdu.refusing_code) == (refused, code if refused else NOT_REFUSED)

    talk, transaction = exchanged(group, subfunction, answer)
    assert (transaction.has_errors, transaction.failed, transaction.refused) == (refused,) * 3
    assert (transaction.outcome, transaction.error_code) == ("answered", 0)
    assert [(error.where, error.code, error.name) for error in transaction.errors] == (
        [("data", code, RETURN_CODES.name(code))] if refused else []
    )
    assert ("transaction.refused" in talk.slugs()) is refused
    assert "transaction.item_error" not in talk.slugs()

    talk = Talk()  # the same answer without its request: the capture begins behind it
    talk.tell(answer)
    talk.finish()
    (transaction,) = talk.transactions
    assert (transaction.outcome, transaction.failed, transaction.refused) == ("orphan_answer", refused, refused)


@pytest.mark.parametrize("code", [0x0A, 0x05, 0x00, 0xFF])
def test_an_error_code_says_it_already(code: int) -> None:
    _, transaction = exchanged(4, 1, told(4, 1, code, b"", 0xD402))
    assert [(error.where, error.code) for error in transaction.errors] == [("parameter", 0xD402)]


def test_the_length_field_of_a_refusal_is_not_believed() -> None:
    """Snap7 servers state a length of 4 behind a refusing code, and no data follow (reference 3.5)."""
    _, transaction = exchanged(4, 1, told(4, 1, 0x0A, b"", length=4))
    assert [error.coded for error in transaction.errors] == ["0x0a Object does not exist"]


def test_data_that_the_capture_lacks_are_not_refused() -> None:
    answer = told(7, 1, 0x0A, PAYLOAD)
    assert not parse_pdu(answer[:-10], cut=True).refused
    assert not parse_pdu(answer[:-14], cut=True).refused
    assert not parse_pdu(told(7, 1, 0x0A, b"")[:-4], cut=True).refused
    assert not parse_pdu(userdata(1, head(RESPONSE, 7, 1, 1, 0), b"")).refused  # no data head at all


@pytest.mark.parametrize("kind", [0, 1])
def test_requests_and_pushes_refuse_nothing(kind: int) -> None:
    assert not parse_pdu(userdata(1, head(kind, 4, 1, 1, 0), EMPTY)).refused


def test_the_sentence_says_that_data_are_missing() -> None:
    _, transaction = exchanged(7, 1, told(7, 1, 0x0A, b""))
    (error,) = transaction.errors
    assert "look at the error code" in RETURN_CODES.text(0x0A)
    assert "instead of data" in error.text
    assert error.text != RETURN_CODES.text(0x0A)
    _, transaction = exchanged(7, 1, told(7, 1, 0x05, b""))
    assert transaction.errors[0].text == RETURN_CODES.text(0x05)


# ---- answers in parts -----------------------------------------------------------------------------------------------

LIST: Final = bytes.fromhex("0000 0000 0002 0004") + bytes(8)


def chained(talk: Talk, *pieces: bytes | int, sequences: tuple[int, ...] = (3, 3, 3)) -> None:
    """An answer in parts; a number is the return code of a part without payload. The last one says that it is the last."""
    for number, piece in enumerate(pieces, 1):
        talk.ask(events.asks(number, 4, 1, sequence=3) if number > 1 else events.szl(number, 0))
        last = number == len(pieces)
        content, code = (b"", piece) if isinstance(piece, int) else (piece, 0xFF)
        parameters = build.userdata_head(RESPONSE, 4, 1, sequences[number - 1], 9, 0 if last else 1)
        talk.tell(build.pdu(build.USERDATA, number, parameters, build.data_item(code, 9, content)))


@pytest.mark.parametrize("code", [0x0A, 0x05, 0x00])
@pytest.mark.parametrize(
    ("before", "after"),
    [((LIST[:8],), ()), ((LIST[:8], LIST[8:12]), ()), ((), (LIST[8:],)), ((LIST[:8],), (LIST[8:],))],
)
def test_a_part_that_is_refused(code: int, before: tuple[bytes, ...], after: tuple[bytes, ...]) -> None:
    """Whichever part has no payload, the answer in parts is not whole, and the operation failed."""
    talk = Talk()
    talk.open()
    talk.operations.clear()
    chained(talk, *before, code, *after)
    talk.close()
    refused = [transaction for transaction in talk.transactions if transaction.refused]
    assert [transaction.request_frame for transaction in refused] == [8 + 2 * len(before)]
    assert talk.slugs().count("transaction.refused") == 1
    operation = talk.operations[0]
    assert (operation.kind, operation.result, operation.content) == ("long_answer", "failed", b"")
    assert operation.error is not None
    assert (operation.error.where, operation.error.code) == ("data", code)
    joiner = Joiner()
    assert [joiner.feed(transaction) for transaction in talk.transactions] == [None] * len(talk.transactions)


def test_a_refusal_need_not_name_the_answer() -> None:
    talk = Talk()
    talk.open()
    talk.operations.clear()
    chained(talk, LIST[:8], 0x0A, sequences=(3, 0))
    talk.close()
    assert [(one.kind, one.result) for one in talk.operations] == [("long_answer", "failed")]


def test_an_empty_last_part_that_is_good() -> None:
    talk = Talk()
    talk.open()
    talk.operations.clear()
    chained(talk, LIST, 0xFF)
    talk.close()
    (operation,) = talk.operations
    assert (operation.result, operation.content) == ("done", LIST)


# ---- what is made of an answer --------------------------------------------------------------------------------------


def test_jobs_that_are_refused_do_not_run() -> None:
    """A subscription, a test job, messages and a BSEND, whose answer has a refusing return code and no payload."""
    for group, subfunction, content, kind in (
        (2, 1, bytes.fromhex("00 01 01 0a") + build.any_item(4, 1, 1, 0x84, 0), "cyclic"),
        (1, 2, b"", "test_job"),
        (4, 2, b"\x01\x00HmiRtm  ", "messages"),
        (5, 1, bytes(8), "password"),
    ):
        talk = Talk()
        talk.open()
        talk.operations.clear()
        talk.ask(userdata(1, head(REQUEST, group, subfunction), build.payload(content)))
        talk.tell(told(group, subfunction, 0x05, b""))
        talk.close()
        assert [(one.kind, one.result, one.error_code) for one in talk.operations] == [(kind, "refused", 0x05)]
        assert talk.connections[0].subscriptions == {}


def test_an_acknowledged_job_runs() -> None:
    talk = Talk()
    talk.open()
    talk.operations.clear()
    talk.ask(userdata(1, head(REQUEST, 1, 2)))
    talk.tell(told(1, 2, 0x0A, b""))
    talk.close()
    assert [(one.kind, one.result) for one in talk.operations] == [("test_job", "running")]


def test_a_refused_password_is_no_login() -> None:
    talk, _ = exchanged(5, 1, told(5, 1, 0x05, b""))
    assert "security.password_failed" in talk.slugs()
    assert "security.password" not in talk.slugs()
    talk, _ = exchanged(5, 1, told(5, 1, 0x0A, b""))
    assert "security.password" in talk.slugs()


def test_a_denied_request_is_protected() -> None:
    talk, _ = exchanged(3, 3, told(3, 3, 0x03, b""))
    assert [finding.detail for finding in talk.findings if finding.slug == "security.protected"] == [
        "10.0.0.1:50000 to 10.0.0.2:102: block functions: get block info, refused: 0x03 Access not allowed"
    ]
    talk, _ = exchanged(3, 3, told(3, 3, 0x0A, b""))
    assert "security.protected" not in talk.slugs()


def test_a_command_that_is_refused_was_not_accepted() -> None:
    talk, _ = exchanged(7, 2, told(7, 2, 0x05, b""))
    (detail,) = [finding.detail for finding in talk.findings if finding.slug == "security.clock_set"]
    assert detail.endswith(", refused: 0x05 Invalid address")
    talk, _ = exchanged(7, 2, told(7, 2, 0x0A, b""))
    (detail,) = [finding.detail for finding in talk.findings if finding.slug == "security.clock_set"]
    assert detail.endswith(", accepted")


def test_a_clock_that_was_not_set_or_read_is_no_fact() -> None:
    time = bytes.fromhex("00202401021304050607")
    for subfunction, asked, code, content, facts in (
        (2, time, 0x0A, b"", 1),  # set, and acknowledged
        (2, time, 0x05, b"", 0),
        (1, b"", 0xFF, time, 1),
        (1, b"", 0x0A, b"", 0),
    ):
        talk = Talk()
        talk.open()
        talk.ask(userdata(1, head(REQUEST, 7, subfunction), build.payload(asked)))
        talk.tell(told(7, subfunction, code, content))
        assert len(Evidence().of_transaction(talk.transactions[0])) == facts


@given(
    st.lists(st.tuples(st.sampled_from([0xFF, 0xFF, 0x0A, 0x06, 3]), st.integers(0, 3)), min_size=1, max_size=4),
    st.integers(0, 3),
    st.integers(-1, 1),
)
def test_codes_of_a_plain_read_are_those_of_its_results(told: list[tuple[int, int]], short: int, more: int) -> None:
    data = b""
    for code, size in told:
        data += b"\0" * (len(data) % 2)
        data += build.data_item(code, 4, bytes(size)) if code == 0xFF else build.refused_item(code)
    talk = Talk()
    talk.open(8, 8)
    talk.ask(read(1, *(item(0x84, 1, 8 * number, 2) for number in range(len(told)))))
    talk.tell(ack_data(1, bytes([4, len(told) + more]), data[: len(data) - short]))
    (transaction,) = talk.transactions
    codes = [one.return_code for one in transaction.s7_results if one.answer is not None]
    assert read_codes(transaction) == codes
    refused = [one.detail.split(": ")[1][:4] for one in talk.findings if one.slug == "transaction.item_error"]
    assert refused == [f"0x{code:02x}" for code in codes if code != 0xFF]


def test_only_plain_reads_have_codes_of_their_own() -> None:
    def of(asked: bytes, answer: bytes) -> list[int] | None:
        talk = Talk()
        talk.open(8, 8)
        talk.ask(asked)
        talk.tell(answer)
        (transaction,) = talk.transactions
        return read_codes(transaction)

    one = item(0x84, 1, 8, 2)
    assert of(read(1, one), ack_data(1, b"\x04\x01", build.refused_item(0x0A))) == [0x0A]
    assert of(read(1, item(0x84, 1, 3, 2)), ack_data(1, b"\x04\x01", build.refused_item(0x0A))) is None
    assert of(write(1, [one], written(2, b"\0")), ack_data(1, b"\x05\x01", b"\x0a")) is None
    assert of(read(1, one), ack_data(1, b"\x04\x01", b"", 0x8500)) is None
    assert of(read(1, one), ack(1, 0x8104)) is None
    assert of(read(1, one), ack_data(1, b"\x05\x01", b"\x0a")) is None


@each(
    ("data", "codes"),
    [
        (
            build.data_item(0xFF, 4, b"abc") + b"\0" + build.refused_item(0x0A) + build.data_item(0xFF, 4, b"d"),
            [255, 10, 255],
        ),
        (build.refused_item(5) + build.data_item(0xFF, 9, b"abc") + b"\0" + build.refused_item(3), [5, 255, 3]),
        (build.data_item(0xFF, 9, bytes(300)) + build.refused_item(0x0A) + build.refused_item(3), [255, 10, 3]),
        (build.data_item(0xFF, 4, bytes(40)) + build.refused_item(0x0A), [255, 10]),
    ],
)
def test_codes_are_found_behind_data_of_any_size(data: bytes, codes: list[int]) -> None:
    talk = Talk()
    talk.open(8, 8)
    talk.ask(read(1, *(item(0x84, 1, 8 * number, 2) for number in range(3))))
    talk.tell(ack_data(1, b"\x04\x03", data))
    assert read_codes(talk.transactions[0]) == codes


def test_an_open_or_orphaned_read_has_no_codes() -> None:
    talk = Talk()
    talk.open(8, 8)
    talk.tell(ack_data(5, b"\x04\x01", build.refused_item(0x0A)))
    talk.ask(read(1, item(0x84, 1, 8, 2)))
    talk.finish()
    assert [read_codes(one) for one in talk.transactions] == [None, None]
