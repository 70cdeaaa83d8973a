"""Which recorded answer a request gets, without sockets."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.s7.message import Pdu, parse_pdu
from dissect.testing.messages import pdu, userdata
from dissect.testing.playback.server import Recording
from dissect.testing.playback.server.answer_index import item_answers
from dissect.testing.playback.server.player import CYCLE, FakePlc, Reply, Stage
from dissect.testing.talk import (
    Ask,
    Talk,
    data,
    done,
    error,
    granted,
    ints,
    items,
    octets,
    read,
    refused,
    setup,
    szl,
    values,
    words,
    write,
)
from tests.testing.playback.server.support import small


def player(recording: Recording, repeat: str = "last", memory: bool = False) -> FakePlc:
    stage = Stage(recording, repeat, memory)
    return FakePlc(stage, stage.script_for(None, None))


def reply(to: FakePlc, ask: Ask, reference: bytes = b"\x12\x34") -> Reply:
    told = to.reply(parse_pdu(ask.octets[:4] + reference + ask.octets[6:]))
    assert told.octets[4:6] in {reference, b""}
    return told


def told(to: FakePlc, ask: Ask) -> Pdu:
    return parse_pdu(reply(to, ask).octets)


def test_a_client_that_pushes_is_refused() -> None:
    """It mistakes the type of its request (pyS7); what programs send each other wants no answer."""
    plc = player(small())
    begin, payload = bytes.fromhex("3207 0000 0001 0008 0008 00 01 12 04 11"), bytes.fromhex("01 00 ff090004 00110000")
    pushed = begin + b"\x04" + payload
    answer = parse_pdu(plc.reply(parse_pdu(pushed)).octets)
    head = answer.parameters.userdata
    assert head is not None
    assert (head.type, head.group, head.subfunction, head.error_code) == (2, 4, 1, 0x8104)
    sent = begin + b"\x06" + payload
    assert plc.reply(parse_pdu(sent)).octets == b""


def word(to: FakePlc, address: str = "DB10.DBW4") -> int:
    return int.from_bytes(told(to, read(address)).data_items()[0].data, "big")


def test_the_first_answer_comes_first_and_the_last_one_stays() -> None:
    plc = player(small())
    assert [word(plc) for _ in range(6)] == [1, 2, 3, 3, 3, 3]


def test_or_the_first_one_comes_again() -> None:
    plc = player(small(), CYCLE)
    assert [word(plc) for _ in range(7)] == [1, 2, 3, 1, 2, 3, 1]


def test_each_client_hears_it_from_the_beginning() -> None:
    stage = Stage(small())
    plcs = [FakePlc(stage, stage.script_for(None, None)) for _ in range(3)]
    assert [word(plc) for plc in plcs] == [1, 1, 1]


def test_items_of_several_requests_make_an_answer() -> None:
    plc = player(small())
    answer = reply(plc, read("MW2", "DB10.DBW4", "DB99.DBW0", "DB10.DBW6"))
    assert answer.how == "items"
    found = parse_pdu(answer.octets).data_items()
    assert [(item.return_code, item.data.hex()) for item in found] == [
        (0xFF, "0007"),
        (0xFF, "0001"),
        (0x0A, ""),
        (0xFF, "0006"),
    ]
    assert word(plc) == 1  # the request as it was recorded counts for itself
    assert reply(plc, read("MW2")).how == "items"


def test_an_odd_item_is_filled_up_unless_it_is_the_last() -> None:
    talk = Talk()
    talk >> read("MB0") << values(7)
    talk >> read("MB9") << values(9)
    plc = player(talk.recording())
    assert told(plc, read("MB0", "MB9", "MB0")).data.hex() == "ff04000807" + "00" + "ff04000809" + "00" + "ff04000807"


def test_an_item_that_nobody_recorded_does_not_exist() -> None:
    answer = reply(player(small()), read("DB10.DBW4", "DB10.DBW100", "T5"))
    assert parse_pdu(answer.octets).return_codes() == [0xFF, 0x0A, 0x0A]
    assert (answer.how, answer.lacking) == (
        "unmatched",
        "not recorded: DB10.DBW100, T5 (nearest recorded: DB10.DBW4; DB10.DBW6; DB99.DBW0)",
    )


def test_a_write_of_another_value_is_the_same_write() -> None:
    plc = player(small())
    assert reply(plc, write("DB10.DBW8 = 5")).how == "same"
    assert reply(plc, write("DB10.DBW8 = 6")).how == "valued"
    answer = reply(plc, write("DB10.DBW8 = 1", "DB10.DBW90 = 2"))
    assert parse_pdu(answer.octets).return_codes() == [0xFF, 0x0A]
    assert answer.lacking == "not recorded: DB10.DBW90 (nearest recorded: DB10.DBW8)"


@pytest.mark.parametrize(
    ("ask", "code"),
    [
        (userdata(4, 2, b"\x01\x00"), 0x8104),
        (szl(0x1234), 0x8104),
        (pdu(bytes.fromhex("32010000000000050000") + b"\x29\x00\x00\x00\x00"), 0x8104),
    ],
)
def test_what_nothing_is_like_is_not_available(ask: Ask, code: int) -> None:
    answer = reply(player(small()), ask)
    found = parse_pdu(answer.octets)
    head = found.parameters.userdata
    assert (head.error_code if head else found.error_class << 8 | found.error_code) == code
    assert head is None or (head.type, head.extended) == (2, True)
    assert found.malformed == []
    assert answer.how == "unmatched"


def test_a_list_is_found_by_what_it_asks_for() -> None:
    plc = player(small())
    assert reply(plc, szl(0x11)).how == "same"
    assert reply(plc, szl(0x11, 1)).how == "unmatched"


@pytest.mark.parametrize(("asked", "gets"), [(480, 480), (960, 480), (240, 240)])
def test_what_is_granted_is_what_was_but_no_more_than_is_asked_for(asked: int, gets: int) -> None:
    plc = player(small())
    found = told(plc, setup(asked, 8, 8)).parameters.setup
    assert found is not None
    assert (found.pdu_length, found.max_amq_calling, found.max_amq_called) == (gets, 1, 1)
    assert plc.pdu_length == gets


def test_without_a_recorded_setup_something_usual_is_granted() -> None:
    talk = Talk(begin=False)
    talk >> read("MW0") << words(1)
    found = told(player(talk.recording()), setup(960, 1, 1)).parameters.setup
    assert found is not None
    assert (found.pdu_length, found.max_amq_calling) == (480, 1)


def test_an_answer_that_is_larger_than_agreed_is_refused() -> None:
    talk = Talk(pdu=480)
    talk >> read("DB1.DBB0 x300") << values(*[0] * 300)
    plc = player(talk.recording())
    told(plc, setup(240))
    answer = reply(plc, read("DB1.DBB0 x300"))
    assert parse_pdu(answer.octets).error_class == 0x85
    assert "the negotiated PDU length is 240" in answer.lacking
    plc = player(talk.recording())
    told(plc, setup(480))
    assert reply(plc, read("DB1.DBB0 x300")).how == "same"
    assert parse_pdu(reply(plc, read("DB1.DBB0 x300", "DB1.DBB0 x300")).octets).error_class == 0x85


def test_a_recorded_refusal_is_given_again() -> None:
    talk = Talk()
    talk >> read("DB5.DBW0") << error(0x8104)
    talk >> setup(240) << granted(240)
    for memory in (False, True):
        answer = reply(player(talk.recording(), memory=memory), read("DB5.DBW0"))
        assert (answer.how, parse_pdu(answer.octets).error_class) == ("same", 0x81)


def test_a_request_that_was_not_answered_is_not_answered() -> None:
    talk = Talk()
    talk >> read("DB5.DBW0")
    talk.unanswered()
    talk >> read("DB5.DBW2") << words(2)
    talk.close()
    plc = player(talk.recording())
    assert reply(plc, read("DB5.DBW0")).octets == b""
    assert word(plc, "DB5.DBW2") == 2


def test_clients_are_given_the_connection_with_their_tsaps_and_else_the_next_one() -> None:
    recording = Recording("made up")
    for called in (b"\x01\x02", b"\x01\x03", b"\x01\x02"):
        recording.scripts += Talk(called=called).recording().scripts
    stage = Stage(recording)
    scripts = recording.scripts
    chosen = [stage.script_for(b"\x01\x00", b"\x01\x03"), stage.script_for(b"\x09\x00", b"\x01\x03")]
    assert chosen == [scripts[1], scripts[1]]
    assert [stage.script_for(b"\x01\x00", b"\x01\x02") for _ in range(3)] == [scripts[0], scripts[2], scripts[0]]
    assert stage.script_for(b"\x07\x00", b"\x07\x07") is scripts[2]


# ---- memory ---------------------------------------------------------------------------------------------------------


def test_memory_begins_as_recorded_and_keeps_what_is_written() -> None:
    talk = Talk()
    talk >> read("DB1.DBW0", "DB1.DBB2 x2", "MB5") << items(words(0x0102), values(3, 4), values(0xF0))
    talk >> read("DB1.DBW0") << words(0xFFFF)
    plc = player(talk.recording(), memory=True)
    assert word(plc, "DB1.DBW0") == 0x0102
    assert reply(plc, write("DB1.DBB1 x2 = <aa bb>")).how == "memory"
    assert [word(plc, "DB1.DBW0"), word(plc, "DB1.DBW2")] == [0x01AA, 0xBB04]
    assert told(plc, read("M5.4", "M5.3")).data.hex() == "ff03000101" + "00" + "ff03000100"
    reply(plc, write("M5.3 = true", "M5.7 = false"))
    assert told(plc, read("MB5")).data_items()[0].data == b"\x78"


def test_one_memory_for_all_clients() -> None:
    talk = Talk()
    talk >> read("MW0") << words(1)
    stage = Stage(talk.recording(), memory=True)
    first, second = (FakePlc(stage, stage.script_for(None, None)) for _ in range(2))
    reply(first, write("MW0 = 77"))
    assert word(second, "MW0") == 77


def test_what_memory_does_not_know_does_not_exist() -> None:
    talk = Talk()
    talk >> read("MW0", "DB3.DBW0") << items(words(1), refused(0x05))
    plc = player(talk.recording(), memory=True)
    assert told(plc, read("MW0", "MW1", "DB3.DBW0")).return_codes() == [0xFF, 0x0A, 0x05]
    assert told(plc, write("MW0 = 1", "MW2 = 1")).return_codes() == [0xFF, 0x0A]
    assert word(plc, "MW0") == 1
    wrong = write("MW0 = 258").octets[:-6] + b"\x00\x04\x00\x08\x05"
    wrong = wrong[:8] + (5).to_bytes(2, "big") + wrong[10:]
    assert told(plc, Ask(wrong)).return_codes() == [0x07]


def test_what_was_refused_to_be_written_is_refused_and_not_written() -> None:
    talk = Talk()
    talk >> read("T5") << octets(b"\x10\x20")
    talk >> write("T5 = <00 01>") << items(refused(0x03))
    plc = player(talk.recording(), memory=True)
    assert told(plc, write("T5 = <00 01>")).return_codes() == [0x03]
    assert told(plc, read("T5")).data_items()[0].data == b"\x10\x20"


def test_timers_are_two_octets_each() -> None:
    talk = Talk()
    talk >> read("T5 x2") << octets(b"\x01\x02\x03\x04")
    plc = player(talk.recording(), memory=True)
    assert told(plc, read("T6")).data_items()[0].data == b"\x03\x04"
    assert told(plc, read("T7")).return_codes() == [0x0A]


def test_memory_answers_with_the_sizes_of_the_recorded_server() -> None:
    talk = Talk()
    talk >> read("DB1.DBW0 INT", "DB1.DBD4 REAL") << items(ints(-1), values(1.5))
    plc = player(talk.recording(), memory=True)
    found = told(plc, read("DB1.DBW0 INT", "DB1.DBD4 REAL", "DB1.DBW4")).data_items()
    assert [(item.transport_size, item.length) for item in found] == [(5, 16), (7, 4), (4, 16)]


# ---- anything -------------------------------------------------------------------------------------------------------


@given(st.binary(max_size=300), st.booleans())
def test_whatever_is_asked_is_answered_or_not_but_never_raises(said: bytes, memory: bool) -> None:
    plc = player(small(), memory=memory)
    plc.reply(parse_pdu(said))
    plc.reply(parse_pdu(b"\x32\x01\x00\x00" + said))
    plc.reply(parse_pdu(b"\x32\x07\x00\x00" + said))
    plc.reply(parse_pdu(b"\x32\x01\x00\x00\x00\x01" + len(said).to_bytes(2, "big") + b"\x00\x00\x04\x05" + said))


def test_an_answer_of_another_form_has_no_items() -> None:
    asked = parse_pdu(read("MW0", "MW2").octets)
    assert item_answers(asked, error().build(asked)) == []
    assert item_answers(asked, done().build(parse_pdu(write("MW0 = 1").octets))) == []
    assert item_answers(asked, b"") == []
    assert len(item_answers(asked, items(words(1), words(2)).build(asked))) == 2
    assert data(b"").build(parse_pdu(szl(0x11).octets))
