"""Scenarios of the rules about security. Each silent one is the nearest harmless neighbour of what the rule speaks of."""

from __future__ import annotations

from tests.engine.findings import events
from tests.engine.findings.operation_scenarios import load, read_out
from tests.engine.findings.registry import silent, speaks
from tests.engine.transactions.talk import SECOND, Talk, ack_data, dbw, item, job, read, refused, words, write, written

QB0 = item(0x82, 0, 0, 2)
MB0 = item(0x83, 0, 0, 2)


def put(talk: Talk, where: bytes) -> None:
    """One octet is written, and taken."""
    talk.ask(write(1, [where], written(4, b"\x01")))
    talk.tell(ack_data(1, b"\x05\x01", b"\xff"))


def order(talk: Talk, pdu: bytes, function: int, code: int = 0) -> None:
    """Something is asked for and answered with the function alone."""
    talk.open()
    talk.ask(pdu)
    talk.tell(events.answered(1, function, code))


@silent(
    "security.alarm_change",
    "security.clock_set",
    "security.debug",
    "security.flash_led",
    "security.force",
    "security.memory",
    "security.nc_command",
    "security.password",
    "security.password_failed",
    "security.plc_start",
    "security.plc_stop",
    "security.program_change",
    "security.program_read",
    "security.protected",
    "security.stopped",
    "security.write",
    "security.write_outputs",
)
def only_looking(talk: Talk) -> None:
    """A panel reads variables, the clock and the block list, monitors a variable, and reads something that is not there."""
    talk.open()
    talk.ask(read(1, QB0))
    talk.tell(words(1, 5))
    talk.ask(read(1, dbw(9, 0)))
    talk.tell(ack_data(1, b"\x04\x01", refused(0x0A)))
    talk.ask(events.asks(2, 7, 1))
    talk.tell(events.tells(2, 7, 1, bytes.fromhex("00191408200959305800")))
    talk.ask(events.asks(3, 3, 1))
    talk.tell(events.tells(3, 3, 1, b"0A\x00\x07"))
    talk.ask(events.asks(4, 1, 2, events.TEST_JOB))
    talk.tell(events.tells(4, 1, 2, sequence=2))
    talk.ask(events.service(5, "_N_F_OPEN", events.texts("P01", "/_N_WKS_DIR", "1")))
    talk.tell(events.answered(5, 0x28))
    talk.tell(events.mode(2))


@speaks("security.plc_stop")
def stop(talk: Talk) -> None:
    order(talk, events.stop(1), 0x29)
    talk.pipeline.exchange.report_findings()
    assert talk.findings[-1].detail == "10.0.0.1:50000 to 10.0.0.2:102: PLC stop, accepted"


@speaks("security.plc_start")
def start(talk: Talk) -> None:
    order(talk, events.service(1, "P_PROGRAM"), 0x28, 0x8104)
    talk.pipeline.exchange.report_findings()
    details = [finding.detail for finding in talk.findings if finding.slug == "security.plc_start"]
    assert details[0].startswith("10.0.0.1:50000 to 10.0.0.2:102: PI service ")
    assert ", refused: 0x8104 " in details[0]


@speaks("security.stopped")
def stopped(talk: Talk) -> None:
    talk.open()
    talk.tell(events.mode(0))


@speaks("security.mode_changed")
def running(talk: Talk) -> None:
    talk.open()
    talk.tell(events.mode(2))


@silent("security.mode_changed")
def stopped_is_said_otherwise(talk: Talk) -> None:
    stopped(talk)


@speaks("security.program_change")
def block_loaded(talk: Talk) -> None:
    talk.open()
    load(talk)


@speaks("security.program_read")
def block_read_out(talk: Talk) -> None:
    talk.open()
    read_out(talk)


@speaks("security.memory")
def memory_reset(talk: Talk) -> None:
    talk.open()
    talk.ask(events.asks(1, 1, 0x0C, bytes.fromhex("00000000")))
    talk.tell(events.tells(1, 1, 0x0C))
    talk.ask(events.service(2, "_MODU", b"EP"))
    talk.tell(events.answered(2, 0x28))
    talk.pipeline.exchange.report_findings()
    assert talk.slugs().count("security.memory") == 2


@speaks("security.force")
def modified(talk: Talk) -> None:
    talk.open()
    talk.ask(events.asks(1, 1, 8, events.MODIFY))
    talk.tell(events.tells(1, 1, 8, sequence=2))


@speaks("security.debug")
def block_status(talk: Talk) -> None:
    talk.open()
    for pdu_ref in (1, 2):
        talk.ask(events.asks(pdu_ref, 1, 0x0B, bytes.fromhex("00020000") + b"\0\0"))
        talk.tell(events.tells(pdu_ref, 1, 0x0B))
    talk.finish()
    talk.pipeline.exchange.report_findings()
    assert talk.slugs().count("security.debug") == 1


@speaks("security.flash_led")
def flash(talk: Talk) -> None:
    talk.open()
    talk.ask(events.asks(1, 1, 0x16, bytes.fromhex("00000000")))
    talk.tell(events.tells(1, 1, 0x16))


@speaks("security.write")
def flags_are_written(talk: Talk) -> None:
    talk.open()
    put(talk, MB0)
    put(talk, dbw(1, 0))
    talk.pipeline.exchange.report_findings()
    assert talk.slugs().count("security.write") == 1  # once, whatever follows


@speaks("security.write_outputs")
def outputs_are_written(talk: Talk) -> None:
    talk.open()
    put(talk, MB0)
    put(talk, QB0)


@speaks("security.write_refused")
def nothing_is_written(talk: Talk) -> None:
    talk.open()
    for code in (0x03, 0x0A):
        talk.ask(write(1, [QB0], written(4, b"\x01")))
        talk.tell(ack_data(1, b"\x05\x01", bytes((code,))))
    talk.pipeline.exchange.report_findings()
    said = {finding.slug: finding.detail for finding in talk.findings}
    assert said["security.write_refused"].endswith(": Write Var QB0 = 1, refused: 0x03 Access not allowed")
    assert talk.slugs().count("security.write_refused") == 1
    assert "security.write_outputs" not in said


@silent("security.write_refused")
def written_not_answered_or_only_read(talk: Talk) -> None:
    talk.open()
    put(talk, QB0)
    talk.ask(read(1, dbw(9, 0)))
    talk.tell(ack_data(1, b"\x04\x01", refused(0x03)))
    talk.ask(write(2, [MB0], written(4, b"\x01")))


@speaks("security.new_writer")
def two_masters(talk: Talk) -> None:
    talk.open()
    put(talk, MB0)
    other = Talk(client_port=50001, beside=talk)
    other.hosts = [9, 2]
    other.open()
    put(other, MB0)
    put(other, QB0)
    talk.pipeline.exchange.report_findings()
    assert talk.slugs().count("security.new_writer") == 1


@silent("security.new_writer")
def one_master_twice(talk: Talk) -> None:
    talk.open()
    put(talk, MB0)
    again = Talk(client_port=50001, beside=talk)
    again.open()
    put(again, MB0)


def password(talk: Talk, code: int, times: int) -> None:
    for pdu_ref in range(1, times + 1):
        talk.ask(events.asks(pdu_ref, 5, 1, events.PASSWORD))
        talk.tell(events.tells(pdu_ref, 5, 1, code=code))


@speaks("security.password")
def password_accepted(talk: Talk) -> None:
    talk.open()
    password(talk, 0, 1)
    assert not [finding for finding in talk.findings if events.PASSWORD.hex() in finding.detail]


@speaks("security.password_failed")
def password_refused(talk: Talk) -> None:
    talk.open()
    password(talk, 0xD602, 1)


@speaks("security.password_guessing")
def passwords_refused(talk: Talk) -> None:
    talk.open()
    password(talk, 0xD602, 2)
    again = Talk(client_port=50001, beside=talk)
    again.open()
    password(again, 0xD602, 1)


@silent("security.password_guessing")
def a_slip(talk: Talk) -> None:
    talk.open()
    password(talk, 0xD602, 2)
    password(talk, 0, 1)
    password(talk, 0xD602, 2)


@speaks("security.protected")
def access_denied(talk: Talk) -> None:
    talk.open()
    talk.ask(read(1, dbw(9, 0)))
    talk.tell(ack_data(1, b"\x04\x01", refused(0x0A)))
    talk.ask(read(1, item(0x1D, 0, 1, 0x1D)))
    talk.tell(ack_data(1, b"\x04\x01", refused(0x03)))
    talk.ask(read(1, item(0x1D, 0, 1, 0x1D)))
    talk.tell(ack_data(1, b"\x04\x01", refused(0x03)))
    talk.pipeline.exchange.report_findings()
    assert talk.slugs().count("security.protected") == 1


@speaks("security.clock_set")
def clock_set(talk: Talk) -> None:
    talk.open()
    talk.ask(events.asks(1, 7, 2, bytes.fromhex("00191408200959305800")))
    talk.tell(events.tells(1, 7, 2))


@speaks("security.reconnaissance")
def who_are_you(talk: Talk) -> None:
    talk.open()
    for pdu_ref, szl_id in enumerate((0x0011, 0x001C, 0x0111, 0x0232), 1):
        talk.ask(events.szl(pdu_ref, szl_id))
        talk.tell(events.no_szl(pdu_ref))
    talk.pipeline.exchange.report_findings()
    assert talk.slugs().count("security.reconnaissance") == 1


@silent("security.reconnaissance")
def how_are_you(talk: Talk) -> None:
    """The same list for hours, and a look at the name of the device."""
    talk.open()
    for pdu_ref in range(1, 50):
        talk.ask(events.szl(pdu_ref, 0x0074))
        talk.tell(events.no_szl(pdu_ref))
    for pdu_ref in (50, 51):
        talk.ask(events.szl(pdu_ref, 0x0011))
        talk.tell(events.no_szl(pdu_ref))


@speaks("security.alarm_change")
def alarm_acknowledged(talk: Talk) -> None:
    talk.open()
    talk.ask(events.asks(1, 4, 0x0B, bytes.fromhex("0901") + bytes.fromhex("12081900600000010000")))
    talk.tell(events.tells(1, 4, 0x0B, bytes.fromhex("0901ff")))


@speaks("security.nc_command")
def file_deleted(talk: Talk) -> None:
    order(talk, events.service(1, "_N_F_DELE", events.texts("P01", "/_N_WKS_DIR")), 0x28)


@speaks("security.unknown_service")
def made_up_service(talk: Talk) -> None:
    order(talk, events.service(1, "_XYZA"), 0x28)
    talk.pipeline.exchange.report_findings()
    assert talk.findings[-1].detail == "10.0.0.1:50000 to 10.0.0.2:102: PI service _XYZA, accepted"


@silent("security.unknown_service")
def services_in_the_tables_or_without_a_name(talk: Talk) -> None:
    order(talk, events.service(1, "_N_XYZA_", events.texts("P01")), 0x28)  # one of a numerical control, whatever it is
    talk.ask(events.service(2, "P_PROGRAM"))
    talk.tell(events.answered(2, 0x28))
    talk.ask(job(3, b"\x28"))
    talk.tell(events.answered(3, 0x28))
    talk.pipeline.exchange.report_findings()
    assert talk.slugs().count("security.nc_command") == 1


@speaks("security.flood")
def without_pauses(talk: Talk) -> None:
    talk.open(called=9)
    for _ in range(8):
        talk.flood(300)


@silent("security.flood")
def many_over_a_long_time(talk: Talk) -> None:
    talk.open(called=9)
    for _ in range(8):
        talk.flood(300)
        talk.wait(SECOND // 2)
