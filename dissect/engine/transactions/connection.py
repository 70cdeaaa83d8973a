"""`Connection`: a transport connection from the user's point of view.

Its ends, TSAPs, negotiated values, open requests, and its ending.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from mypy_extensions import i64

from dissect.engine.transactions.aside import Aside
from dissect.engine.transactions.ending import OPEN, Ending
from dissect.engine.transactions.open_requests import OpenRequests
from dissect.engine.transactions.operation import Activation, OpenOperations
from dissect.engine.transactions.results import Subscription
from dissect.engine.transactions.writes import Writes
from dissect.packets.tcp.connection import TcpConnection
from dissect.packets.tcp.stream import Endpoint
from dissect.protocols.iso.cotp import Tpdu
from dissect.protocols.iso.tsap import Tsap
from dissect.protocols.s7.parameters import Parameters, Setup
from dissect.protocols.s7.tables import (
    DOWNLOAD_BLOCK,
    DOWNLOAD_ENDED,
    END_UPLOAD,
    GROUP_PBC,
    PI_SERVICE,
    PLC_STOP,
    READ_VAR,
    REQUEST_DOWNLOAD,
    SETUP_COMMUNICATION,
    START_UPLOAD,
    UPLOAD,
    WRITE_VAR,
)
from dissect.wire.copies import leaves

if TYPE_CHECKING:
    from dissect.engine.transactions.naming import Naming
    from dissect.engine.transactions.transaction import Transaction
    from dissect.protocols.s7plus.session import PlusSession
    from dissect.protocols.tls.session import TlsSession

# What is known of the protocol of a TCP connection (`Connection.state`); `Connection.protocol` has its name.
PROBING: Final = 0
ISO: Final = 1  # ISO-on-TCP; a separate value, because nearly every packet checks for it
FOREIGN: Final = 2  # not S7: its octets are only counted
FOLLOWED: Final = 3  # read by another protocol of the engine: IBH-NetLink, SCD where a port is bound to it
LEFT_OUT: Final = 4  # recognised and numbered, but not selected: its content is not read

#: `Connection._dt_limit` while no size is known to be wrong.
NO_LIMIT: Final = 0x7FFFFFFF

#: Jobs that identify the client (reference 5.3); in a download the PLC sends the requests.
_ASKED_BY_CLIENT: Final = frozenset(
    (
        READ_VAR,
        WRITE_VAR,
        REQUEST_DOWNLOAD,
        START_UPLOAD,
        UPLOAD,
        END_UPLOAD,
        PI_SERVICE,
        PLC_STOP,
        SETUP_COMMUNICATION,
    )
)
_ASKED_BY_SERVER: Final = frozenset((DOWNLOAD_BLOCK, DOWNLOAD_ENDED))

#: The port ISO-on-TCP is registered on.
ISO_TSAP_PORT: Final = 102

#: Maximum number of distinct SZL-IDs, and of loaded blocks, that are remembered per connection.
MAX_REMEMBERED: Final = 256

#: Maximum number of empty DTs that are remembered per connection: more than can be open at once (AmQ).
MAX_EARLY: Final = 16

#: The open requests of a finished connection. Its sides are dropped, so no further request is opened.
_NONE_OPEN: Final[list[OpenRequests]] = [OpenRequests(), OpenRequests()]


class EarlyAck:
    """A DT without data that ``side`` sent while a request to it was open: its packet and time."""

    __slots__ = ("frame", "side", "time_ns")

    def __init__(self, side: i64, frame: i64, time_ns: i64) -> None:
        self.side: i64 = side
        self.frame: i64 = frame
        self.time_ns: i64 = time_ns


class Traits:
    """The uses of a connection so far; the security rules need them. Every part of it is bounded.

    ``written`` has a bit for each kind of area that was written (`dissect.protocols.s7.items.written_areas`), ``sent`` for each
    that may have been written, because there was no answer. ``told`` has the slugs that are reported only once per connection,
    ``szl_ids`` the requested lists, ``loaded`` the loaded blocks by name. ``stop_event`` is the latest diagnostic message that
    states a STOP: its event, packet and time.
    """

    __slots__ = (
        "_early",
        "_loaded",
        "_szl_ids",
        "_told",
        "_writes",
        "aside",
        "inquiries",
        "pace_ns",
        "refusals",
        "sent",
        "stop_event",
        "written",
    )

    def __init__(self) -> None:
        self.written: i64 = 0
        self.sent: i64 = 0
        self._writes: Writes | None = None
        self.pace_ns = 0
        self.inquiries = 0
        self.refusals = 0
        self.stop_event: tuple[int, int, int] | None = None
        # Created on first use: most connections only read and write.
        self._told: set[str] | None = None
        self._szl_ids: set[int] | None = None
        self._loaded: dict[str, Activation] | None = None
        self._early: list[EarlyAck] | None = None
        self.aside: Aside | None = None

    def note_early(self, side: i64, frame: i64, time_ns: i64) -> None:
        """Remember that ``side`` acknowledged a request with an empty DT; only the latest ones are kept."""
        found = self._early
        if found is None:
            found = self._early = []
        if len(found) >= MAX_EARLY:
            del found[0]
        found.append(EarlyAck(side, frame, time_ns))

    def early_ack(self, side: i64, since: i64, until: i64) -> EarlyAck | None:
        """Return the first empty DT of ``side`` after packet ``since`` and before packet ``until``, if it is kept."""
        for one in self._early or []:
            if one.side == side and since < one.frame < until:
                return one
        return None

    @property
    def told(self) -> set[str]:
        """The slugs that were already reported on it."""
        found = self._told
        if found is None:
            found = self._told = set()
        return found

    @property
    def szl_ids(self) -> set[int]:
        """The ids of the SZL lists that were requested."""
        found = self._szl_ids
        if found is None:
            found = self._szl_ids = set()
        return found

    @property
    def loaded(self) -> dict[str, Activation]:
        """The loaded blocks, by name."""
        found = self._loaded
        if found is None:
            found = self._loaded = {}
        return found

    @property
    def has_loaded(self) -> bool:
        """True when blocks were loaded."""
        return self._loaded is not None and len(self._loaded) > 0

    @property
    def hasty(self) -> Writes | None:
        """Its writes, if some came fast and without an answer; else None."""
        found = self._writes
        return found if found is not None and found.hasty is not None else None

    @property
    def counted(self) -> Writes | None:
        """Its writes, if some are not yet in the facts of findings; else None."""
        found = self._writes
        return found if found is not None and found.again > 0 else None

    @property
    def writes(self) -> Writes:
        """The latest writes of the connection."""
        found = self._writes
        if found is None:
            found = self._writes = Writes()
        return found

    def first(self, slug: str) -> bool:
        """Return whether ``slug`` was not reported on this connection before, and remember it."""
        if slug in self.told:
            return False
        self.told.add(slug)
        return True


class Connection:
    """One transport connection over one TCP connection.

    ``number`` counts from 1 in order of first octets. Sides are those of ``tcp``. ``client_side`` is the side that opened the
    connection, by the best evidence: SYN, CR, role of the jobs, port 102; ``client_known``: there is better evidence than a
    port number. Negotiated values that were not captured are None or 0, never a guess.
    """

    __slots__ = (
        "_begun",
        "_bound",
        "_dt_limit",
        "_operations",
        "_probed",
        "_probed_frame",
        "_probed_ns",
        "_setup_by",
        "_state",
        "_subscriptions",
        "_told",
        "_traits",
        "answered",
        "behind",
        "class_",
        "client_known",
        "client_side",
        "closed_reason",
        "cr_class",
        "cr_ref",
        "cr_seen",
        "ending",
        "errors",
        "granted",
        "granted_for",
        "identified_by",
        "iso_ended",
        "iso_ended_by",
        "iso_ended_frame",
        "iso_ended_how",
        "iso_ended_ns",
        "last_answer",
        "last_answer_ns",
        "last_encrypted_ns",
        "last_error",
        "last_error_code",
        "last_error_ns",
        "last_request",
        "last_request_ns",
        "mid_stream",
        "naming",
        "not_captured",
        "number",
        "one_way",
        "open_at_end",
        "open_requests",
        "orphans",
        "pdu_length",
        "pdus",
        "plus",
        "protocol",
        "refused",
        "setup_asked",
        "setup_open",
        "setup_seen",
        "still_open",
        "system_events",
        "tcp",
        "tls",
        "tpdu_size",
        "tpdu_size_asked",
        "tsap_called",
        "tsap_calling",
        "tsap_frame",
        "udp",
        "unanswered",
        "unsolicited",
    )

    #: Unanswered because the capture ended before their answer was due; the answer may just be missing from the capture.
    still_open: i64
    not_captured: i64

    def __init__(self, number: i64, tcp: TcpConnection) -> None:
        self.number: i64 = number
        self.tcp: TcpConnection = tcp
        self.udp: bool = False  # a conversation over UDP, which has neither beginning nor end
        self._bound: i64 = -1  # number of the SCD binding for its TSAPs or ports, -1 while undetermined
        self.naming: Naming | None = None  # names for addresses of this CPU
        self._state: i64 = PROBING
        self._probed: i64 = 0  # segments with octets that were examined while probing
        self._probed_frame: i64 = 0  # the packet of the first of them, and its time
        self._probed_ns: i64 = 0
        self.plus: PlusSession | None = None  # facts of S7comm-plus about client, CPU and subscriptions
        #: S7comm-plus requests in several frames, by sequence number and packet of the last frame: packet and time of the first
        #: frame, and the number of octets that were not kept.
        self._begun: dict[tuple[int, int], tuple[int, int, int]] | None = None
        self.tls: TlsSession | None = None  # there from the first record of TLS on
        self.protocol: str = ""  # the name of the protocol in its TSDUs
        self.identified_by: str = ""  # how a protocol other than S7 was identified, as text
        self.client_side: i64 = 0
        self.client_known: bool = False
        self._find_client(tcp)
        self.mid_stream: bool = not tcp.known_start
        self.cr_seen: bool = False
        self.cr_ref: i64 = 0
        self.cr_class: i64 = 0
        self.class_: i64 = -1  # chosen by the CC, -1 if no CC was seen
        #: A larger DT is examined closely. It is -1, so that every DT is examined, until the connection is set up and after its
        #: end.
        self._dt_limit: i64 = -1 if tcp.known_start else NO_LIMIT
        self._told: i64 = 0  # what was reported on it, one bit for each of some rules (dissect.engine.findings)
        self.tsap_calling: Tsap | None = None
        self.tsap_called: Tsap | None = None
        self.tsap_frame: i64 = 0  # the packet with the TSAPs: the CR, or else the CC
        self.tpdu_size_asked: i64 = 0
        self.tpdu_size: i64 = 0
        self.refused: str = ""
        self.iso_ended: str = ""  # a DR or ER, in words
        self.iso_ended_how: str = ""
        self.iso_ended_by: i64 = -1
        self.iso_ended_frame: i64 = 0
        self.iso_ended_ns: i64 = 0
        self.setup_asked: Setup | None = None
        self.granted: Setup | None = None
        self.granted_for: Setup | None = None  # the setup that was requested then; a later one may have been refused
        self._setup_by: i64 = 0
        self.setup_seen: bool = False
        self.setup_open: bool = False  # a setup was requested and is not answered yet
        self.pdu_length: i64 = 0  # granted, 0 while unknown
        self.open_requests: list[OpenRequests] = [OpenRequests(), OpenRequests()]
        # Created on first use, and released at the end: many connections do not need them.
        self._operations: OpenOperations | None = None
        self._traits: Traits | None = None
        self._subscriptions: dict[int, Subscription] | None = None
        self.pdus: i64 = 0
        self.behind: i64 = 0  # whole PDUs behind malformed TPDU headers, which are not in ``pdus``
        self.answered: i64 = 0
        self.unanswered: i64 = 0
        self.still_open = self.not_captured = 0
        self.orphans: i64 = 0
        self.unsolicited: i64 = 0
        self.one_way: i64 = 0  # requests that need no answer; ``unsolicited`` includes them
        self.system_events: i64 = 0  # S7comm-plus PDUs that belong to no transaction
        self.errors: i64 = 0
        # The latest request, answer and refusal: only their parameter blocks, which are shared when a client polls, not the
        # whole transactions.
        self.last_request: Parameters | None = None
        self.last_request_ns: i64 = 0
        self.last_answer: Parameters | None = None
        self.last_answer_ns: i64 = 0
        self.last_encrypted_ns: i64 = 0  # when the server last sent something in TLS
        self.last_error: Parameters | None = None
        self.last_error_ns: i64 = 0
        self.last_error_code: i64 = 0
        self.closed_reason: str = ""
        self.open_at_end: i64 = 0
        self.ending: Ending | None = None  # set once the connection is over

    def _find_client(self, tcp: TcpConnection) -> None:
        """Find the client by the handshake, otherwise by the ports."""
        if tcp.initiator >= 0:
            self._set_client(tcp.initiator)
        elif tcp.ends[0].port == ISO_TSAP_PORT and tcp.ends[1].port != ISO_TSAP_PORT:
            self.client_side = 1

    def __repr__(self) -> str:
        arrow = "→" if self.client_known else "↔"
        return f"Connection({self.number}, {self.client} {arrow} {self.server}, {self.pdus} PDUs)"

    @property
    def client(self) -> Endpoint:
        """The end that opened the connection."""
        return self.tcp.ends[self.client_side]

    @property
    def server(self) -> Endpoint:
        """The other end."""
        return self.tcp.ends[1 - self.client_side]

    @property
    def missed(self) -> i64:
        """Number of requests whose answer was due and did not come (`Transaction.missed`)."""
        return self.unanswered - self.still_open - self.not_captured

    @property
    def operations(self) -> OpenOperations:
        """The unfinished operations."""
        found = self._operations
        if found is None:
            found = self._operations = OpenOperations()
        return found

    @property
    def has_open_operations(self) -> bool:
        """True when an operation is under way."""
        found = self._operations
        if found is None:
            return False
        return len(found.these) > 0 or len(found.halves) > 0 or (found.plus is not None and len(found.plus.objects) > 0)

    @property
    def traits(self) -> Traits:
        """The uses of the connection so far."""
        found = self._traits
        if found is None:
            found = self._traits = Traits()
        return found

    def early_ack(self, transaction: Transaction) -> EarlyAck | None:
        """Return the empty DT by which the answering side acknowledged a request before its answer, None if there is none."""
        traits = self._traits
        if traits is None:
            return None
        return traits.early_ack(1 - transaction.asked_by, transaction.request_frame, transaction.response_frame)

    @property
    def _aside(self) -> Aside | None:
        """Waiting messages behind malformed TPDU headers, None if there are none."""
        aside = self._traits.aside if self._traits is not None else None
        return aside if aside is not None and aside.held else None

    @property
    def has_loaded(self) -> bool:
        """True when blocks were loaded on it."""
        return self._traits is not None and self._traits.has_loaded

    @property
    def _counted_writes(self) -> Writes | None:
        """Its writes that are not yet in the facts of findings; None if there are none."""
        return self._traits.counted if self._traits is not None else None

    @property
    def _hasty_writes(self) -> Writes | None:
        """Its writes, if some came fast and without an answer; None for nearly every connection."""
        return self._traits.hasty if self._traits is not None else None

    @property
    def subscriptions(self) -> dict[int, Subscription]:
        """The messages that its cyclic and test jobs send, by job (`dissect.engine.transactions.results`)."""
        found = self._subscriptions
        if found is None:
            found = self._subscriptions = {}
        return found

    @property
    def subscribes(self) -> bool:
        """True when cyclic or test jobs of it send values."""
        return self._subscriptions is not None and len(self._subscriptions) > 0

    def _let_go(self) -> None:
        """After its end and report: keep what reports show of it, and release its working data."""
        self.open_requests = _NONE_OPEN
        self._operations = None
        self._traits = None
        self._subscriptions = None
        self._begun = None

    @property
    def ended(self) -> str:
        """How it ended (`Ending.how`); ``open`` while it is not over."""
        return self.ending.how if self.ending is not None else OPEN

    @property
    def last_frame(self) -> i64:
        """The latest packet of the connection."""
        return self.ending.last_frame if self.ending is not None else self.tcp.last_frame

    @property
    def last_ns(self) -> i64:
        """The time of its latest packet."""
        return self.ending.last_ns if self.ending is not None else self.tcp.last_ns

    def role(self, side: i64) -> str:
        """Name a side: ``client`` or ``server``."""
        return "client" if side == self.client_side else "server"

    def _set_client(self, side: i64) -> None:
        """Note evidence that ``side`` is the client; the first evidence of this strength counts."""
        if not self.client_known:
            self.client_side = side
            self.client_known = True

    @property
    def followed(self) -> bool:
        """True while the octets of the connection are read, by any protocol."""
        return self._state == ISO or self._state == FOLLOWED

    @property
    def established(self) -> bool:
        """True when data or a CC was seen."""
        return (self._state == ISO or self._state == LEFT_OUT) and (self.pdus > 0 or self.tpdu_size > 0)

    def _note_cr(self, side: i64, tpdu: Tpdu, frame: i64) -> None:
        """A connect request in packet ``frame``: it names its sender, the TSAPs and the size."""
        self.cr_seen = True
        self._set_client(side)
        self.tsap_calling = tpdu.tsap(0xC1)
        self.tsap_called = tpdu.tsap(0xC2)
        self.tsap_frame = frame
        self.tpdu_size_asked = tpdu.tpdu_size
        self.cr_ref = tpdu.field("src_ref")
        self.cr_class = tpdu.field("class_")

    def _note_cc(self, side: i64, tpdu: Tpdu, frame: i64) -> None:
        """A connect confirm in packet ``frame``: it has the final size, and the TSAPs if the CR was not captured."""
        self._set_client(1 - side)
        self.class_ = max(0, tpdu.field("class_"))
        self.tpdu_size = tpdu.tpdu_size or 65531
        self._dt_limit = self.tpdu_size
        if self.tsap_calling is None and self.tsap_called is None:
            self.tsap_frame = frame
        if self.tsap_calling is None:
            self.tsap_calling = tpdu.tsap(0xC1)
        if self.tsap_called is None:
            self.tsap_called = tpdu.tsap(0xC2)

    def _note_request(self, side: i64, parameters: Parameters) -> None:
        """Without a handshake, the request identifies the client (reference 5.3)."""
        userdata = parameters.userdata
        if userdata is not None:
            if userdata.group != GROUP_PBC:  # either end may send a BSEND request
                self._set_client(side)
        elif parameters.function in _ASKED_BY_SERVER:
            self._set_client(1 - side)
        elif parameters.function in _ASKED_BY_CLIENT:
            self._set_client(side)

    def _note_answer(self, side: i64, parameters: Parameters) -> None:
        """An answer from the registered port identifies the client; one to that port contradicts it and proves nothing."""
        if self.tcp.ends[side].port == ISO_TSAP_PORT and self.tcp.ends[1 - side].port != ISO_TSAP_PORT:
            self._note_request(1 - side, parameters)

    def _note_iso_end(self, words: str, how: str, side: i64, frame: i64, time_ns: i64) -> None:
        """A DR or ER of ``side``: the transport connection is over, unless something follows."""
        self.iso_ended = words
        self.iso_ended_how = how
        self.iso_ended_by = side
        self.iso_ended_frame = frame
        self.iso_ended_ns = time_ns
        self._dt_limit = -1

    def _note_one_way(self) -> None:
        """Count a request that needs no answer."""
        self.unsolicited += 1
        self.one_way += 1

    def _note_error(self, asked: Parameters, time_ns: i64, code: i64) -> None:
        """Note an answer with an error: ``code`` in its header or parameter, otherwise in an item."""
        self.errors += 1
        self.last_error = asked
        self.last_error_ns = time_ns
        self.last_error_code = code

    def _grant(self, setup: Setup, asked_by: i64) -> None:
        """Take the answer to the setup that ``asked_by`` sent: its values apply from now on."""
        self.granted = setup
        self.granted_for = self.setup_asked
        self._setup_by = asked_by
        self.pdu_length = setup.pdu_length

    def jobs_allowed(self, asked_by: i64) -> i64:
        """Return how many requests ``asked_by`` may have open, 0 if that was not captured.

        "Calling" is the side that sent the setup job (reference 3.4).
        """
        granted = self.granted
        if granted is None:
            return 0
        return granted.max_amq_called if asked_by == self._setup_by else granted.max_amq_calling


leaves(Connection, without=("_operations", "_subscriptions", "_begun", "_traits", "open_requests"))
