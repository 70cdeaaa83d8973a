"""The list of acts: every way to ask for one in S7comm and S7comm-plus, how each ends, and that all faces read it."""

from __future__ import annotations

from pathlib import Path

import pytest

from dissect.engine.acts import tables as kinds
from dissect.engine.acts.act import Act
from dissect.engine.acts.tables import ACTS, OUTCOMES
from dissect.engine.findings.catalogue import CATALOGUE
from dissect.engine.findings.reporter import Finding
from dissect.engine.observer import Observer
from dissect.engine.transactions import operation as operations
from dissect.engine.transactions.operation import Operation
from dissect.files.session import Run
from dissect.meaning.select import Where
from dissect.meaning.select.sieve import Sieve
from dissect.protocols.s7.services import PI_SERVICES
from dissect.protocols.s7.tables import READ, USERDATA_SUBFUNCTIONS
from dissect.protocols.s7plus.contents import VariableAddress
from dissect.protocols.s7plus.objects import PlusObject, build_object
from dissect.protocols.s7plus.tables import CREATE_OBJECT, DELETE_OBJECT, SET_MULTI_VARIABLES, SET_VARIABLE
from dissect.protocols.s7plus.value_tables import BLOB, DINT, UINT
from dissect.protocols.s7plus.values import Blob, Value
from tests import build
from tests.engine.findings import events
from tests.engine.findings.test_plus_rules import DENIED, NOTHING, begun, block, do, explore
from tests.engine.program.transfers import carry, download, upload
from tests.engine.transactions.talk import Talk, ack, ack_data, item, write, written
from tests.protocols.s7plus import bodies
from tests.protocols.s7plus.pdus import asked, framed

CAPTURES = Path(__file__).parents[3] / "captures"
#: Findings that are readings of acts.
SLUGS = {kind.slug for kind in ACTS.values()} - {""}
PI = {
    "_INSE": kinds.ACTIVATE,
    "_INS2": kinds.ACTIVATE,
    "_DELE": kinds.DELETE,
    "P_PROGRAM": kinds.START,
    "_MODU": kinds.TO_ROM,
    "_GARB": kinds.COMPRESS,
    "_N_LOGIN_": kinds.PASSWORD,
    "_N_LOGOUT": kinds.PROTECTION,
    "_N_NEWPWD": kinds.PROTECTION,
    "_N_F_PROT": kinds.PROTECTION,
    "_N_F_PROR": kinds.PROTECTION,
    "_N_NEVERMET": kinds.NC,
    "_FREE": kinds.UNKNOWN,
}
ENDINGS = [(0, kinds.ACCEPTED), (0xD241, kinds.REFUSED), (-1, kinds.UNANSWERED)]


def told(talk: Talk) -> list[tuple[str, str]]:
    talk.close()
    return [(act.kind, act.outcome) for act in talk.acts]


def slugs(talk: Talk) -> list[str]:
    return [one.slug for one in talk.findings if one.slug in SLUGS]


@pytest.mark.parametrize(("code", "outcome"), ENDINGS)
@pytest.mark.parametrize("name", [*PI_SERVICES, "_N_NEVERMET", "_FREE"])
def test_every_pi_service(name: str, code: int, outcome: str) -> None:
    """Asked and carried out, asked and refused, asked and not answered; one that only reads is no act."""
    row = PI_SERVICES.get(name)
    talk = Talk()
    talk.open()
    talk.ask(events.service(1, name, events.blocks("0A00001P") if name in {"_INSE", "_INS2", "_DELE"} else b""))
    if code >= 0:
        talk.tell(events.answered(1, 0x28, code))
    expected = PI.get(name, kinds.NC)
    if row is not None and row.effect == READ:
        assert told(talk) == []
        assert slugs(talk) == []
        return
    assert told(talk) == [(expected, outcome)]
    (act,) = talk.acts
    assert slugs(talk) == [act.slug]
    assert act.slug == ("security.nc_command" if name.startswith("_N_") else ACTS[expected].slug)
    assert act.error_code == max(0, code)
    assert act.frames == talk.transactions[0].frames
    assert (act.client, act.server) == (str(talk.connections[0].client.host), str(talk.connections[0].server.host))
    made = [one.kind for one in talk.operations if one.kind != "connect"]
    assert made == ([ACTS[expected].operation] if expected in {kinds.START, kinds.DELETE} else [])


def test_a_cold_restart_says_so() -> None:
    talk = Talk()
    talk.open()
    for number, block_ in enumerate((b"", b"C "), 1):
        talk.ask(events.service(number, "P_PROGRAM", block_))
        talk.tell(events.answered(number, 0x28))
    assert told(talk) == [(kinds.START, kinds.ACCEPTED), (kinds.RESTART, kinds.ACCEPTED)]
    assert slugs(talk) == ["security.plc_start"] * 2


#: Userdata by group and subfunction that is an act, and which.
USERDATA = {
    (1, 0x01): kinds.TEST, (1, 0x02): kinds.MONITOR, (1, 0x08): kinds.FORCE, (1, 0x09): kinds.FORCE, (1, 0x0A): kinds.TEST,
    (1, 0x0B): kinds.TEST, (1, 0x0C): kinds.RESET, (1, 0x12): kinds.FORCE, (1, 0x13): kinds.TEST, (1, 0x16): kinds.FLASH,
    (4, 0x07): kinds.ALARMS, (4, 0x08): kinds.ALARMS, (4, 0x0B): kinds.ALARMS, (5, 0x01): kinds.PASSWORD,
    (5, 0x02): kinds.PROTECTION, (7, 0x02): kinds.CLOCK, (7, 0x04): kinds.CLOCK, (0x3F, 0x01): kinds.DOWNLOAD,
    (0x3F, 0x06): kinds.UPLOAD,
}  # fmt: skip


@pytest.mark.parametrize(("code", "outcome"), [(0, kinds.ACCEPTED), (0xD602, kinds.REFUSED), (-1, kinds.UNANSWERED)])
@pytest.mark.parametrize(
    ("group", "subfunction"), [(group, row.number) for group, table in USERDATA_SUBFUNCTIONS.items() for row in table]
)
def test_every_userdata_request(group: int, subfunction: int, code: int, outcome: str) -> None:
    talk = Talk()
    talk.open()
    talk.ask(events.asks(1, group, subfunction, bytes(16)))
    if code >= 0:
        talk.tell(events.tells(1, group, subfunction, bytes(16), code=code))
    kind = USERDATA.get((group, subfunction), "")
    assert told(talk) == ([(kind, outcome)] if kind else [])
    if kind == kinds.PASSWORD and code > 0:
        assert [one.slug for one in talk.findings if one.slug.startswith("security.password")] == [
            "security.password_failed"
        ]
    elif kind and kind != kinds.PROTECTION and ACTS[kind].slug:  # there a session gives its rights back
        assert slugs(talk) == [ACTS[kind].slug]
    else:
        assert slugs(talk) == []


@pytest.mark.parametrize(("code", "outcome"), ENDINGS)
def test_a_stop(code: int, outcome: str) -> None:
    talk = Talk()
    talk.open()
    talk.ask(events.stop(1))
    if code >= 0:
        talk.tell(events.answered(1, 0x29, code))
    assert told(talk) == [(kinds.STOP, outcome)]
    assert slugs(talk) == ["security.plc_stop"]


@pytest.mark.parametrize("asks", [0, 1], ids=["the client sends", "the PLC asks"])
def test_a_download_and_an_upload_are_an_act_each(asks: int) -> None:
    """With all their packets, their octets and their blocks."""
    talk = Talk()
    talk.open()
    carry(talk, download(bytes(300), "_0A00007P", asks=asks))
    carry(talk, upload(bytes(300), "_0A00007A", 7, ref=2000))
    talk.close()
    assert [(act.kind, act.outcome, act.octets) for act in talk.acts] == [
        (kinds.DOWNLOAD, kinds.ACCEPTED, 300),
        (kinds.UPLOAD, kinds.ACCEPTED, 300),
    ]
    for act, operation in zip(talk.acts, talk.operations[1:], strict=True):
        assert act.operation is operation
        assert (act.first_frame, act.last_frame) == (operation.first_frame, operation.last_frame)
        assert [one.label for one in act.blocks()] == ["DB7"]
    assert slugs(talk) == ["security.program_change", "security.program_read"]


@pytest.mark.parametrize(("code", "outcome"), ENDINGS)
@pytest.mark.parametrize(("request_", "function", "kind"), [
    (events.request_download(1), 0x1A, kinds.DOWNLOAD), (events.start_upload(1), 0x1D, kinds.UPLOAD),
])  # fmt: skip
def test_a_transfer_that_does_not_begin(request_: bytes, function: int, kind: str, code: int, outcome: str) -> None:
    if not code:
        return  # as above
    talk = Talk()
    talk.open()
    talk.ask(request_)
    if code > 0:
        talk.tell(events.answered(1, function, code))
    assert told(talk) == [(kind, outcome)]
    assert talk.acts[0].blocks() == []


def test_the_first_write_to_outputs_is_an_act_however_it_ends() -> None:
    """So are the first that is refused and the first that is not answered; writes elsewhere are none."""
    talk = Talk()
    talk.open()
    outputs, flags = item(0x82, 0, 0, 2), item(0x83, 0, 0, 2)
    for number, (where, code) in enumerate(
        ((flags, 0xFF), (outputs, 5), (outputs, 5), (outputs, 0xFF), (outputs, 0xFF)), 1
    ):
        talk.ask(write(number, [where], written(4, b"\1")))
        talk.tell(ack_data(number, b"\5\1", bytes((code,))))
    assert told(talk) == [(kinds.OUTPUTS, kinds.REFUSED), (kinds.OUTPUTS, kinds.ACCEPTED)]
    assert [(act.error_code, str(act.error)) for act in talk.acts] == [(5, "item: Invalid address"), (0, "None")]
    other = Talk()
    other.open()
    other.ask(write(1, [outputs], written(4, b"\1")))
    assert told(other) == [(kinds.OUTPUTS, kinds.UNANSWERED)]


def test_an_act_of_outputs_names_outputs_only_and_why_they_were_refused() -> None:
    talk = Talk()
    talk.open()
    content = build.joined([written(4, b"\1")] * 3)
    talk.ask(write(1, [item(0x83, 0, 0, 2), item(0x82, 0, 8, 2), item(0x84, 1, 0, 2)], content))
    talk.tell(ack_data(1, b"\5\3", b"\x0a\x03\xff"))
    assert told(talk) == [(kinds.OUTPUTS, kinds.REFUSED)]
    assert (talk.acts[0].subject, talk.acts[0].error_code) == ("Write Var QB1 = 1", 3)


def test_a_refusal_without_parameters_is_one() -> None:
    talk = Talk()
    talk.open()
    talk.ask(events.stop(1))
    talk.tell(ack(1, 0x8104))
    assert told(talk) == [(kinds.STOP, kinds.REFUSED)]


OB = block(0x8A320001, 2647, "Main", 4)


def plus(talk: Talk, number: int, what: str, answer: bytes) -> None:
    """One request of S7comm-plus for an act."""
    if what == kinds.DOWNLOAD:
        do(talk, number, CREATE_OBJECT, bodies.create_object(3, NOTHING, OB, integrity_id=number), answer + b"\0")
    elif what == kinds.DELETE:
        do(talk, number, DELETE_OBJECT, bodies.delete_object(0x8A0E0003), answer + bodies.rid(0x8A0E0003))
    elif what == kinds.PASSWORD:
        secret = Value(0, BLOB, Blob(0, b"x" * 20))
        do(talk, number, SET_VARIABLE, bodies.set_variable(0x386, [304], secret), answer)
    elif what == kinds.TEST:
        job = PlusObject(211, 2709, 0, 0, 0, [])
        do(talk, number, CREATE_OBJECT, bodies.create_object(7, NOTHING, job, integrity_id=number), answer + b"\0")
    elif what == kinds.OUTPUTS:
        address = VariableAddress(0, 81, 3736, [3, 1, 1])
        refused = b"\0" if answer == b"\0" else b"\1" + bodies.number(0xFFF4) + b"\0"
        do(talk, number, SET_MULTI_VARIABLES, bodies.set_multi([(address, Value(0, UINT, 1))]), b"\0" + refused)
    elif what in {kinds.PROTECTION, kinds.FIRMWARE}:
        object_id, attribute = (50, 7918) if what == kinds.PROTECTION else (16, 233)
        do(talk, number, SET_VARIABLE, bodies.set_variable(object_id, [attribute], Value(0, DINT, 1)), answer)
    else:
        state = {kinds.STOP: 1, kinds.RESET: 2, kinds.START: 3, kinds.UNKNOWN: 9}[what]
        do(talk, number, SET_VARIABLE, bodies.set_variable(52, [2167], Value(0, DINT, state)), answer)


@pytest.mark.parametrize(
    "kind",
    [
        kinds.STOP, kinds.START, kinds.RESET, kinds.UNKNOWN, kinds.DOWNLOAD, kinds.DELETE, kinds.PASSWORD, kinds.TEST,
        kinds.OUTPUTS, kinds.PROTECTION, kinds.FIRMWARE,
    ],
)  # fmt: skip
def test_every_act_of_s7comm_plus(kind: str) -> None:
    for answer, outcome in ((b"\0", kinds.ACCEPTED), (DENIED, kinds.REFUSED)):
        talk = begun()
        plus(talk, 1, kind, answer)
        assert told(talk) == [(kind, outcome)]
    talk = begun()
    plus(talk, 1, kind, b"\0")
    request = talk.transactions[-1].request_octets
    talk = begun()
    talk.ask(request)
    assert told(talk) == [(kind, kinds.UNANSWERED)]


def test_a_program_that_is_read_out_by_s7comm_plus() -> None:
    talk = begun()
    explore(talk, 1, build_object(OB))
    assert told(talk) == [(kinds.UPLOAD, kinds.ACCEPTED)]
    assert [one.label for one in talk.acts[0].blocks()] == ["OB1"]


def test_an_order_that_wants_no_answer() -> None:
    talk = begun()
    talk.ask(framed(asked(1, SET_VARIABLE, flags=0x74, body=bodies.set_variable(52, [2167], Value(0, DINT, 1))), 3))
    assert told(talk) == [(kinds.STOP, kinds.UNCONFIRMED)]


def test_a_load_is_one_act_with_all_that_it_carries() -> None:
    talk = begun()
    plus(talk, 1, kinds.DOWNLOAD, b"\0")
    plus(talk, 2, kinds.DOWNLOAD, DENIED)
    assert told(talk) == [(kinds.DOWNLOAD, kinds.FAILED)]
    (act,) = talk.acts
    assert act.transactions == [1, 2]
    assert [one.label for one in act.blocks()] == ["OB1", "OB1"]
    assert act.shown == talk.transactions[0].request_frame


def test_acts_are_numbered_in_their_order() -> None:
    talk = Talk()
    talk.open()
    for number in (1, 2, 3):
        talk.ask(events.stop(number))
        talk.tell(events.answered(number, 0x29))
    talk.close()
    assert [act.number for act in talk.acts] == [1, 2, 3]


def test_words() -> None:
    for name, kind in ACTS.items():
        assert kind.name == name
        assert kind.sentence.endswith(".")
        assert not kind.slug or kind.slug in CATALOGUE
        assert bool(kind.deed) == bool(kind.tried)
    assert all([text.endswith(".") for text in OUTCOMES.values()])


# ---- all faces read the same list -----------------------------------------------------------------------------------


class Faces(Observer):
    """Collects acts, findings and operations of a run."""

    def __init__(self) -> None:
        super().__init__()
        self.acts: list[Act] = []
        self.findings: list[Finding] = []
        self.operations: list[Operation] = []

    def act(self, act: Act) -> None:
        self.acts.append(act)

    def finding(self, finding: Finding) -> None:
        self.findings.append(finding)

    def operation(self, operation: Operation) -> None:
        self.operations.append(operation)


def compare(path: Path) -> None:
    faces = Faces()
    Run([str(path)], faces).read()
    wanted = {(act.slug, int(act.connection.number)) for act in faces.acts if act.slug}
    found = {(one.slug, int(one.connection)) for one in faces.findings if one.slug in SLUGS}
    # what was refused is told by findings about refusals
    refused = {(act.slug, int(act.connection.number)) for act in faces.acts if act.outcome != kinds.ACCEPTED}
    assert found <= wanted
    assert {(slug, number) for slug, number in wanted - found} <= refused
    ours = {operations.DOWNLOAD, operations.UPLOAD, operations.DELETE, operations.CONTROL, operations.PASSWORD}
    done = sorted([(act.row.operation, act.first_frame) for act in faces.acts if act.command or act.operation])
    made = sorted([(one.kind, int(one.first_frame)) for one in faces.operations if one.kind in ours])
    assert [one[0] for one in made] == [kind for kind, _ in done if kind in ours]


@pytest.mark.parametrize("path", sorted((CAPTURES / "crafted").glob("*.pcap*")), ids=lambda path: path.name)
def test_findings_and_operations_agree_with_the_list(path: Path) -> None:
    compare(path)


def test_they_agree_in_shared_captures(corpus: Path) -> None:
    for path in sorted(corpus.rglob("*.pcap*")):
        if "faults" not in path.parts:
            compare(path)


@pytest.mark.parametrize(
    ("expression", "wanted"),
    [
        ("function == 'S7comm-plus SetVariable'", [kinds.STOP, kinds.START]),
        ("kind == download", [kinds.DOWNLOAD]),
        ("function == 'S7comm-plus CreateObject'", [kinds.DOWNLOAD]),
        ("client == 192.0.2.30", []),
        ("server == 192.0.2.20", [kinds.STOP, kinds.START, kinds.DOWNLOAD]),
    ],
)
def test_a_selection_passes_the_acts_of_what_it_selects(expression: str, wanted: list[str]) -> None:
    """By the transaction that asked for it, or by the operation that a transfer was."""
    faces = Faces()
    where = Where(expression)
    Run([str(CAPTURES / "crafted" / "plus-plant.pcapng")], Sieve(faces, where)).read()
    assert [act.kind for act in faces.acts] == wanted
