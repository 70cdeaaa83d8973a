"""What is known of the S7comm-plus sessions of a connection: the client, the CPU, and the subscriptions.

All sizes are limited; nothing here raises.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.protocols.s7plus.contents import Made, VariableAddress
from dissect.protocols.s7plus.identification import is_record, read_record
from dissect.protocols.s7plus.objects import PlusObject
from dissect.protocols.s7plus.program import CODE, Program, symbol
from dissect.protocols.s7plus.program_tables import ROLES
from dissect.protocols.s7plus.stamps import next_stamp
from dissect.wire.copies import leaves
from dissect.wire.text import printable

# Classes and attributes.
SUBSCRIPTION: Final = 1001
SERVER_SESSION: Final = 287
REFERENCE_LIST: Final = 1048
#: Attribute that holds the name of an object.
NAME: Final = 233
_APPLICATION: Final = 297
_HOST: Final = 298
_ROLE: Final = 299
_USER: Final = 296
_SESSION_VERSION: Final = 306
_VERSION_TEXT: Final = 319
_CHALLENGE: Final = 303
#: Attribute by which a client authenticates itself: the key of its session, encrypted for the CPU.
SESSION_KEY: Final = 1830
#: The object that represents the CPU, and has its identification record.
CPU_PROXY: Final = 49
CPU_EXEC_UNIT: Final = 52
STATE_REQUEST: Final = 2167  # written to the execution unit: STOP, RUN …
#: Further attributes of blocks and subscriptions.
NUMBER: Final = 2521
LANGUAGE: Final = 2523
CODE_TIME: Final = 2529
INTERFACE_TIME: Final = 2543
CYCLE: Final = 1049
#: All attributes of objects that this module and `dissect.protocols.s7plus.events` look for.
ASKED_OF_OBJECTS: Final = CODE | {
    REFERENCE_LIST, NAME, _APPLICATION, _HOST, _ROLE, _USER, _SESSION_VERSION, _CHALLENGE,
    NUMBER, LANGUAGE, CYCLE, STATE_REQUEST,
}  # fmt: skip
OPERATING_STATE: Final = 3486
#: Attribute of every piece of hardware: its condition, with its operating state as a member. Only the operating state of the
#: execution unit is that of the CPU.
DIAGNOSIS: Final = 2237

_NEW_LIST: Final = 0x80000000
#: The largest reference that fits into four octets, as notifications have them.
_MAX_REFERENCE: Final = 0xFFFFFFFF
#: Limits: remembered subscriptions of a connection, and items of one subscription.
MAX_SUBSCRIPTIONS: Final = 256
MAX_ITEMS: Final = 4096

#: Facts that a CPU states about itself (`Identity.told`), and their sources.
ORDER_NUMBER: Final = "order_number"
HARDWARE: Final = "hardware"
FIRMWARE: Final = "firmware"
SERIAL_NUMBER: Final = "serial_number"
OPERATING_MODE: Final = "operating_mode"
IN_SESSION: Final = "S7comm-plus session"
IN_RECORD: Final = "I&M0 record"
IN_VARIABLE: Final = "operating state variable"
_MAX_TOLD: Final = 16

#: The kind of a device, by its statements in S7comm-plus (`PlusSession.client_kind`, `Identity.kind`).
ENGINEERING: Final = "engineering"
OPC: Final = "OPC"
PANEL: Final = "panel"
_BY_ROLE: Final[dict[int, str]] = {1: ENGINEERING, 2: PANEL}
#: The application name of SIMATIC NET's OPC server, whose sessions have the role of a panel.
_SIMATIC_NET: Final = "SIMATIC NET"
#: The beginning of order numbers of panels.
PANEL_ORDER_NUMBERS: Final = "6AV"


class Identity:
    """Order number, firmware and serial number of a CPU, empty if not seen; its latest operating state, -1 if not seen.

    ``told`` collects the statements of the CPU until `StationWatch` takes them: (name of the fact, value, source). ``role`` is
    the role in its answer when a session is opened, -1 if not seen: panels state 2 (HMI), CPUs a number of their own from
    0x20000000 on, or none.
    """

    __slots__ = ("_read", "_record", "firmware", "order_number", "role", "serial_number", "state", "told")

    def __init__(self) -> None:
        self.order_number = ""
        self.firmware = ""
        self.serial_number = ""
        self._record = b""  # the latest identification record
        self._read = ("", "", "", "")  # order number, serial number, hardware and firmware in it
        self.state = -1
        self.role = -1
        self.told: list[tuple[str, str, str]] = []

    def __repr__(self) -> str:
        return printable(f"Identity({self.order_number or 'unknown'}{f', {self.firmware}' if self.firmware else ''})")

    @property
    def kind(self) -> str:
        """``panel`` if its order number or its role states that it is one; else empty."""
        panel = _BY_ROLE.get(self.role, "") == PANEL
        return PANEL if panel or self.order_number.startswith(PANEL_ORDER_NUMBERS) else ""

    def tell(self, key: str, value: str, where: str) -> None:
        """Note a fact that the CPU states about itself."""
        if value and len(self.told) < _MAX_TOLD:
            self.told.append((key, value, where))

    def take(self, octets: bytes) -> None:
        """Take an identification record. Tools request the same one again and again, so it is decoded only if it changed."""
        if octets != self._record:
            self._record = octets
            self._read = read_record(octets)
        self.order_number, self.serial_number, hardware, self.firmware = self._read
        self.tell(ORDER_NUMBER, self.order_number, IN_RECORD)
        self.tell(SERIAL_NUMBER, self.serial_number, IN_RECORD)
        self.tell(HARDWARE, hardware, IN_RECORD)
        self.tell(FIRMWARE, self.firmware, IN_RECORD)


class Counted:
    """The latest of the requests that a client counts together: its sequence number and integrity id, -1 before the first."""

    __slots__ = ("integrity_id", "sequence")

    def __init__(self) -> None:
        self.sequence: i64 = -1
        self.integrity_id: i64 = -1

    def repeats(self, sequence: i64, integrity_id: i64) -> bool:
        """Take the next request; True if its integrity id did not move in the same direction as its sequence number.

        Requests are taken in the order in which they were answered.
        """
        before: i64 = self.integrity_id
        ahead: i64 = (sequence - self.sequence) & 0xFFFF
        later: bool = ahead < 0x8000 or before < 0
        if later:
            self.sequence = sequence
            self.integrity_id = integrity_id
        if before < 0 or ahead == 0:
            return False
        grown: i64 = (integrity_id - before) & 0xFFFFFFFF
        return grown == 0 or (grown < 0x80000000) != later


class PlusSession:
    """What is known about one connection. Texts are from the wire and not escaped.

    ``program`` and ``identity`` are shared by all connections of a CPU. ``states`` are the subscriptions that report the
    operating state of the CPU, each with its references. ``tls``: the client requested TLS. ``challenged``: the CPU offers
    authentication; ``authenticated``: the client used it. ``given`` are the ids of its sessions. ``writes`` and ``reads``:
    clients separately count the requests that change something, and all others. ``explores`` counts Explore requests;
    ``explored`` are the packets of the first and the last one. ``stamp`` is 0 until something is subscribed. Each change of the
    subscriptions sets a number that no other session has.
    """

    __slots__ = (
        "application",
        "authenticated",
        "challenged",
        "explored",
        "explored_ns",
        "explores",
        "given",
        "host",
        "identity",
        "latest",
        "program",
        "reads",
        "role",
        "session_name",
        "stamp",
        "states",
        "subscriptions",
        "tls",
        "user",
        "writes",
    )

    def __init__(self, program: Program, identity: Identity) -> None:
        self.program = program
        self.identity = identity
        self.application = ""
        self.host = ""
        self.role = -1
        self.user = ""
        self.session_name = ""
        self.explores: i64 = 0
        self.explored: list[int] = []
        self.explored_ns: i64 = 0  # time of the last Explore request
        self.tls = False
        self.challenged = False
        self.authenticated = False
        self.given: set[int] = set()
        self.latest: i64 = -1  # the latest id in ``given`` that was used
        self.reads: Counted = Counted()
        self.writes: Counted = Counted()
        self.states: dict[int, list[int]] = {}
        self.subscriptions: dict[int, dict[int, VariableAddress]] = {}
        self.stamp: i64 = 0

    def __repr__(self) -> str:
        return printable(f"PlusSession({self.application or 'application unknown'}, {self.identity!r})")

    @property
    def role_name(self) -> str:
        """``engineering``, ``HMI``, or empty if the client did not state its role."""
        return ROLES.name(self.role) if self.role > 0 else ""

    @property
    def client_kind(self) -> str:
        """The client's statement about its kind: ``engineering``, ``panel``, ``OPC``, or empty.

        An OPC server opens its session in the role of a panel, but its name shows what it is.
        """
        who = self.application or self.session_name
        if who.startswith(_SIMATIC_NET) or "OPC" in f"{who} {self.host}".upper():
            return OPC
        return _BY_ROLE.get(self.role, "")

    def note_explore(self, frame: int, time_ns: i64) -> None:
        """The client sent an Explore request."""
        self.explores += 1
        self.explored = [*self.explored[:1], frame]
        self.explored_ns = time_ns

    def label(self, address: VariableAddress) -> str:
        """Return the text of an address, with names of the program if they are known."""
        found = self.program.find(address)
        return symbol(address, found) if found is not None else address.label

    @property
    def who(self) -> str:
        """The client's name, host and user, as far as the client stated them."""
        who = self.application or self.session_name
        if self.host:
            who = f"{who} on {self.host}" if who else f"on {self.host}"
        if self.user:
            who = f"{who} as {self.user}" if who else f"as {self.user}"
        return who

    def describe(self) -> str:
        """Return the client and the CPU or panel that answers, as a short text."""
        who = self.who
        kind = self.client_kind
        if kind:
            who = f"{who} ({kind})" if who else f"({kind})"
        identity = self.identity
        server, firmware = identity.order_number, identity.firmware
        if firmware:
            server = f"{server} {firmware}" if server else firmware
        return f"{who}, {identity.kind or 'CPU'} {server}" if server else who

    # ---- sessions ---------------------------------------------------------------------------------------------------

    def open_session(self, asked: Made) -> None:
        """Take the request that opens a session: its object describes the client."""
        for one in asked.objects:
            if one.class_id == SERVER_SESSION:
                self.session_name = one.text(NAME)
                self.application = one.text(_APPLICATION)
                self.host = one.text(_HOST)
                self.user = one.text(_USER)
                self.role = one.number(_ROLE)

    def session_opened(self, told: Made) -> None:
        """Take the answer to that request: its object describes the CPU, and shows whether clients can authenticate."""
        self.challenged = False
        self.authenticated = False
        self.reads = Counted()
        self.writes = Counted()
        for id_ in told.ids[:1]:
            if len(self.given) < MAX_SUBSCRIPTIONS:
                self.given.add(id_)
        for one in told.objects:
            self._identify(one.member(_SESSION_VERSION, _VERSION_TEXT))
            if one.holds(_CHALLENGE):
                self.challenged = True
            if one.number(_ROLE) >= 0:
                self.identity.role = one.number(_ROLE)

    def _identify(self, version: str) -> None:
        """Take the version text of a CPU, for example ``1;6ES7 215-1AG40-0XB0 ;V4.3``."""
        words = version.split(";")
        if len(words) == 3 and words[2].startswith("V"):
            self.identity.order_number = words[1].strip()
            self.identity.firmware = words[2].strip()
            self.identity.tell(ORDER_NUMBER, self.identity.order_number, IN_SESSION)
            self.identity.tell(FIRMWARE, self.identity.firmware, IN_SESSION)

    def identified(self, octets: bytes) -> None:
        """Take the identification record of the CPU (I&M0, laid out as in IEC 61158-6-10)."""
        if is_record(octets):
            self.identity.take(octets)

    # ---- subscriptions ----------------------------------------------------------------------------------------------

    def subscribe(self, asked: Made, told: Made, lists: ReferenceLists) -> None:
        """Take a request that creates subscriptions, and the answer with their ids, in the order of the objects.

        ``lists``: the items of each subscription.
        """
        if len(lists) == 0:
            return
        made = [one for one in asked.every if one.class_id == SUBSCRIPTION]
        for number in range(min(len(made), len(told.ids))):
            one, id_ = made[number], told.ids[number]
            self.unsubscribe(id_)
            while len(self.subscriptions) >= MAX_SUBSCRIPTIONS:
                self.unsubscribe(next(iter(self.subscriptions)))
            known = lists[one.offset]
            self.subscriptions[id_] = known
            self._changed(id_, known)

    def change(self, id_: int, told: References) -> None:
        """Take a changed reference list of a subscription."""
        found = self.subscriptions.get(id_)
        if found is None:
            return
        _change(found, told)
        self._changed(id_, found)

    def unsubscribe(self, id_: int) -> None:
        """Forget a subscription, if there is one."""
        if self.subscriptions.pop(id_, None) is not None:
            self._changed(id_, {})

    def _changed(self, id_: int, known: dict[int, VariableAddress]) -> None:
        """Note the items that a subscription reports from now on."""
        self.stamp = next_stamp()
        states = [one for one, address in known.items() if is_state(address) and 0 <= one <= _MAX_REFERENCE]
        if states:
            self.states[id_] = states
        elif id_ in self.states:
            del self.states[id_]

    def address_of(self, subscription: int, reference: int) -> VariableAddress | None:
        """Return the address that belongs to a reference in a notification; None if its subscription was not captured."""
        known = self.subscriptions.get(subscription)
        return known.get(reference) if known is not None else None


#: Content of a reference list: whether it is a new list, the references that it removes, and those that it adds, with
#: addresses.
References = tuple[bool, list[int], list[tuple[int, VariableAddress]]]
#: The items of subscriptions: by the offset of the subscription object in its PDU, the address of each reference.
ReferenceLists = dict[int, dict[int, VariableAddress]]


def _change(known: dict[int, VariableAddress], told: References) -> None:
    new, gone, fresh = told
    if new:
        known.clear()
    for reference in gone:
        known.pop(reference, None)
    for reference, address in fresh:
        if len(known) < MAX_ITEMS:
            known[reference] = address


def is_state(address: VariableAddress) -> bool:
    """Return whether a variable is the operating state of the CPU, or the structure that has it as a member."""
    if address.area != CPU_EXEC_UNIT:
        return False
    return address.lids[-1] == OPERATING_STATE if address.lids else address.sub_area == DIAGNOSIS


def reference_lists_of(objects: list[PlusObject]) -> ReferenceLists:
    """Return the items of the subscriptions among ``objects``."""
    found: ReferenceLists = {}
    for one in objects:
        if one.class_id == SUBSCRIPTION:
            known: dict[int, VariableAddress] = {}
            _change(known, parse_reference_list(one.numbers(REFERENCE_LIST)))
            found[one.offset] = known
    return found


def parse_reference_list(numbers: list[int]) -> References:
    """Read the numbers of a reference list, up to the first item that does not fit."""
    if len(numbers) < 3:
        return False, [], []
    head, removed, added = numbers[:3]
    gone = numbers[3 : 3 + removed]
    at = 3 + removed
    fresh: list[tuple[int, VariableAddress]] = []
    while added and at + 6 <= len(numbers):
        count = numbers[at] & 0xFFFF
        end = at + 5 + max(count, 1)
        if end > len(numbers):
            break
        address = VariableAddress(numbers[at + 4], numbers[at + 3], numbers[at + 5], numbers[at + 6 : end])
        fresh.append((numbers[at + 1], address))
        at = end
        added -= 1
    return bool(head & _NEW_LIST), gone, fresh


def crc_places(numbers: list[int]) -> list[int]:
    """Return the positions of the checksums of symbols in a reference list, up to the first item that does not fit."""
    places: list[int] = []
    at = 3 + numbers[1] if len(numbers) > 3 else 0
    while at + 6 <= len(numbers) and len(places) < numbers[2]:
        places.append(at + 4)
        at += 5 + max(numbers[at] & 0xFFFF, 1)
    return places


leaves(Counted, Identity, PlusSession)
