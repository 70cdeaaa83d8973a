"""The worked examples of the protocol reference as one capture."""

from __future__ import annotations

from captures.craft.case import Case, crafts
from captures.craft.pdus import (
    ASKED,
    DOWNLOAD_BLOCK,
    DOWNLOAD_ENDED,
    MODE,
    NO_FUNCTION,
    PI_SERVICE,
    PLC_STOP,
    READ,
    REQUEST_DOWNLOAD,
    SETUP,
    USERDATA,
    WRITE,
)
from captures.craft.talk import CLIENT, SERVER, Talk
from tests.examples import CLASS_2, NAMED_TSAP, S7, UNKNOWN_ADDRESS, Example

START_UPLOAD, UPLOAD, END_UPLOAD = 0x1D, 0x1E, 0x1F
FIRST_UNANSWERED = "Job Sinumerik NCK item (syntax 0x82)"


@crafts(
    "The 90 worked messages of the protocol reference (section 8), octet for octet: a session of every function, a CR "
    "with a string TSAP refused in two ways, and what only COTP class 2 sends. Not all requests have an answer there."
)
def reference_examples(case: Case) -> None:
    for port, examples in enumerate((S7, NAMED_TSAP, (NAMED_TSAP[0], *UNKNOWN_ADDRESS), CLASS_2), 49152):
        say(Talk(case, client_port=port), examples)
    transfer = (START_UPLOAD, UPLOAD, END_UPLOAD, REQUEST_DOWNLOAD, DOWNLOAD_BLOCK, DOWNLOAD_ENDED)
    case.pair(SETUP, *[READ] * 5, *[WRITE] * 2, *transfer, PI_SERVICE, PLC_STOP, *[USERDATA] * 11)
    for function in (*[READ] * 4, *[PI_SERVICE] * 5, *[USERDATA] * 2):
        case.unanswered(function, "capture_ended")
    for function in (NO_FUNCTION, NO_FUNCTION, PI_SERVICE, *[USERDATA] * 3):
        case.orphan(function)
        case.find("transaction.orphan")
    for function in (MODE, *[USERDATA] * 3):
        case.push(function)
    case.count(item_errors=2, header_errors=5)
    case.find("transaction.item_error", 2)
    case.find("transaction.refused", 5)
    # One job was granted, and the first request without an answer stays open.
    titles = [example.title for example in S7]
    case.find("session.too_many_jobs", sum(asks(example) for example in S7[titles.index(FIRST_UNANSWERED) + 1 :]))
    case.find("session.cut")
    case.find("cotp.error")
    case.find("cotp.refused", 2)
    case.find("cotp.bad_start")
    case.find("session.foreign_on_102")
    # The upload gives 8 octets of 216, and the download ends although more is to come.
    case.find("operation.wrong_size")
    case.find("operation.cut_short")
    case.find("security.program_read")
    case.find("security.program_change", 3)  # the download, _INSE, _DELE
    case.find("security.plc_start", 2)  # warm and cold
    case.find("security.plc_stop")
    case.find("security.stopped")
    case.find("security.memory", 2)  # _MODU, _GARB
    case.find("security.write")
    case.find("security.write_refused")
    case.find("security.clock_set")
    case.find("security.password")
    case.find("security.protected")
    case.find("security.reconnaissance")
    case.table("tsdus", s7comm=case.counts["s7_pdus"], unknown=1)


def asks(example: Example) -> bool:
    """Return whether the client sends a request: a job, or userdata of type request."""
    start = example.octets[7:9]
    return example.from_client and (start == b"\x32\x01" or (start == b"\x32\x07" and example.octets[22] >> 6 == ASKED))


def say(talk: Talk, examples: tuple[Example, ...]) -> None:
    """One connection with these messages, each in its own segment."""
    talk.open()
    for example in examples:
        talk.send(CLIENT if example.from_client else SERVER, example.octets)
