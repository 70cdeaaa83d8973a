"""The catalogue of findings: every slug, with its severity, kind, sentence and advice.

Slugs are stable, because reports, `--fail-on` and users' scripts rely on them. The rules follow reference section 7. They are
defined only here: reports, alerts, exports, documentation and tests all read these rows.
"""

from __future__ import annotations

from typing import Any, Final

from dissect.engine.findings.mitre import TECHNIQUES, Technique

ERROR: Final = "error"
WARNING: Final = "warning"
NOTE: Final = "note"


#: Severities from the heaviest to the lightest.
SEVERITIES: Final = (ERROR, WARNING, NOTE)


#: Kinds of rules, by subject: the capture itself; the octets of a protocol; the negotiation; requests and answers; actions of
#: a possible intruder; operations, which take several requests.
CAPTURE: Final = "capture"
PROTOCOL: Final = "protocol"
NEGOTIATION: Final = "negotiation"
FUNCTION: Final = "function"
SECURITY: Final = "security"
OPERATION: Final = "operation"

KINDS: Final = (CAPTURE, PROTOCOL, NEGOTIATION, FUNCTION, SECURITY, OPERATION)


#: How often a rule reports: each event; the first of a connection, with a count of the others; each distinct request once,
#: without a count; each event, with the detail only for the first of a capture (or of a kind).
EACH: Final = "each"
CONNECTION: Final = "once a connection"
REQUEST: Final = "once a distinct request"
ONE: Final = "once a capture"

REPORTED: Final = (EACH, CONNECTION, REQUEST, ONE)
_REPORTED: Final[dict[str, str]] = {
    "capture.not_opened": ONE,
    "capture.one_sided": CONNECTION,
    "cotp.bad_start": CONNECTION,
    "cotp.empty_dt": CONNECTION,
    "cotp.tpdu_nr": CONNECTION,
    "ip.bad_header": ONE,
    "ip.fragment_invalid": ONE,
    "operation.stray_push": CONNECTION,
    "s7.odd_address": REQUEST,
    "s7.redundancy_id": CONNECTION,
    "s7.unknown_code": REQUEST,
    "s7plus.unknown_kind": CONNECTION,
    "security.alarm_change": CONNECTION,
    "security.clear_text": CONNECTION,
    "security.debug": CONNECTION,
    "security.flood": CONNECTION,
    "security.protected": CONNECTION,
    "security.reconnaissance": CONNECTION,
    "security.session_reused": CONNECTION,
    "security.unauthenticated": CONNECTION,
    "security.write": CONNECTION,
    "security.write_outputs": CONNECTION,
    "security.write_refused": CONNECTION,
    "session.data_before_setup": CONNECTION,
    "session.encrypted": CONNECTION,
    "session.idle": CONNECTION,
    "session.shared_reference": CONNECTION,
    "session.unusual_port": CONNECTION,
    "transaction.odd_data_code": CONNECTION,
}
#: Within a severity, events that change a running plant come first: its mode, its program, its outputs, its memory.
_GRAVE: Final = (
    "security.plc_stop",
    "security.stopped",
    "security.plc_start",
    "security.program_change",
    "security.write_outputs",
    "security.force",
    "security.memory",
)
#: The noun for counted events of a rule; all other rules count "times".
_NOUNS: Final[dict[str, str]] = {
    "s7.odd_address": "distinct request",
    "s7.unknown_code": "distinct request",
    "security.program_read": "request",
    "security.protected": "refused request",
    "security.write": "write",
    "security.write_outputs": "write",
    "security.write_refused": "refused write",
    "stream.refused": "refusal",
    "stream.unanswered": "attempt",
    "transaction.item_error": "refused item",
    "transaction.orphan": "answer",
    "transaction.refused": "refused request",
    "transaction.unanswered": "request",
}


class Rule:
    """One row of the catalogue: a stable slug, its severity, what it is about (kind), one sentence, and advice what to do.

    ``techniques`` are the MITRE ATT&CK for ICS techniques that the finding may be part of; most rules have none. ``reported``
    says how often the rule reports (`REPORTED`); ``noun`` is the word for its events. ``gravity`` orders rules of one severity;
    the lowest comes first.
    """

    __slots__ = ("advice", "gravity", "kind", "noun", "reported", "sentence", "severity", "slug", "techniques")

    def __init__(
        self, slug: str, severity: str, kind: str, sentence: str, advice: str, techniques: tuple[Technique, ...] = ()
    ) -> None:
        self.reported = _REPORTED.get(slug, EACH)
        self.noun = _NOUNS.get(slug, "time")
        self.gravity = _GRAVE.index(slug) if slug in _GRAVE else len(_GRAVE)
        self.slug = slug
        self.severity = severity
        self.kind = kind
        self.sentence = sentence
        self.advice = advice
        self.techniques = techniques

    def __repr__(self) -> str:
        return f"Rule({self.slug!r}, {self.severity!r})"

    def __reduce__(self) -> tuple[Any, ...]:
        return rule_of, (self.slug,)  # a copied finding has the same rule object of the catalogue


def rule_of(slug: str) -> Rule:
    """Return the rule of this slug."""
    return CATALOGUE[slug]


#: Slug, severity, kind, sentence, advice, and the keys of MITRE techniques, separated by spaces.
_ROWS: Final[tuple[tuple[str, str, str, str, str, str], ...]] = (
    # The capture itself.
    ("capture.damaged", WARNING, CAPTURE, "The capture is damaged, or ended too early.",
     "All before that was analyzed. Copy the file again after a clean stop; of a live capture, check the interface.", ""),
    ("capture.dropped", WARNING, CAPTURE, "Packets were lost while capturing.",
     "This can cause gaps and unanswered requests. Filter out what you do not need (-f), or capture on a faster machine.", ""),
    ("capture.cut_frames", WARNING, CAPTURE, "The capture kept only the beginning of some packets (snaplen).",
     "Longer PDUs are known only in part. Capture again with the full packet length (snaplen 0).", ""),
    ("capture.time_backwards", NOTE, CAPTURE, "The clock of the capture runs backwards.",
     "Answer times across the step are unreliable. Check the time synchronisation of the capturing machine.", ""),
    ("capture.one_sided", WARNING, CAPTURE, "Only one direction of a connection was captured.",
     "Requests and answers cannot be paired. Check the mirror port: it must copy both directions.", ""),
    ("capture.not_opened", NOTE, CAPTURE, "Packets were ignored because their encapsulation is not opened.",
     "Their content is unknown; it may be S7. Have the mirror port or sensor send them plain, or decrypt them first.", ""),
    # IP and TCP.
    ("ip.bad_header", WARNING, PROTOCOL, "IP or TCP headers contradict themselves; these packets were ignored.",
     "Lengths or header fields are wrong: a faulty device or network card, or an attempt to mislead analyzers.", ""),
    ("ip.fragment_invalid", WARNING, PROTOCOL, "Invalid IP fragments were ignored.",
     "They reach beyond 65535 bytes or contradict each other. Identify the sender.", ""),
    ("ip.fragment_conflict", WARNING, PROTOCOL, "Overlapping IP fragments carry different data.",
     "The first copy was kept. Look for a faulty device, IP identifiers that are used again too soon, or an attack.", ""),
    ("ip.fragments_evicted", WARNING, CAPTURE, "Too many IP datagrams were incomplete at once; the oldest were dropped.",
     "Fragments are rare in S7 traffic. Identify the sender.", ""),
    ("stream.hole", WARNING, CAPTURE, "Bytes of a connection are missing from the capture.",
     "The capture lost packets or was filtered. The content of the gap is unknown; the devices are not at fault.", ""),
    ("stream.conflict", WARNING, PROTOCOL, "A retransmission carries different data from the first copy.",
     "The first copy was kept. Look for a middlebox that rewrites traffic, or an attack.", "adversary_in_the_middle"),
    ("stream.outside_window", WARNING, PROTOCOL, "TCP segments far outside the receive window were ignored.",
     "A receiver ignores them too, unless the capture has a large gap before them. Look for a middlebox or an attack.", ""),
    ("stream.bad_checksum", WARNING, PROTOCOL, "A packet with a wrong TCP or UDP checksum was ignored, as requested.",
     "It was corrupted or forged, and a receiver drops it. Or the capturing host leaves checksums to its network card.", ""),
    ("stream.reset_ignored", NOTE, PROTOCOL,
     "A TCP RST, FIN or SYN does not fit the connection's sequence numbers and was ignored.",
     "Its address is probably forged: a firewall or intrusion detection system cuts connections, or someone guesses numbers.",
     ""),
    ("stream.reused", NOTE, PROTOCOL,
     "A new connection used the same addresses and ports while the old one was still open.",
     "The old connection's end was not captured, or one side restarted without closing it.", ""),
    ("stream.refused", WARNING, PROTOCOL, "A TCP connection to port 102 was refused.",
     "Wrong address, no S7 server there, no connection free, device still starting, or a firewall that rejects it.", ""),
    ("stream.unanswered", WARNING, PROTOCOL, "A TCP connection to port 102 got no answer, and the client repeated its SYN.",
     "Wrong address, the device is off or unreachable, or a firewall drops the packets. A SYN sent only once is not reported.",
     ""),
    ("stream.evicted", WARNING, CAPTURE,
     "Too many connections were open at once; the longest-idle or largest ones were dropped.",
     "Their pending requests count as unanswered. Analyze the capture in parts if they matter. Idle ones are not reported.",
     ""),
    ("stream.half_open_evicted", NOTE, SECURITY, "More unanswered connection attempts than can be tracked.",
     "A SYN flood or a port scan looks like this. Identify the host that sends them.", "system_discovery denial_of_service"),
    # TPKT and COTP.
    ("tpkt.reserved", WARNING, PROTOCOL, "The reserved byte of a TPKT header is not 0.",
     "RFC 2126 tells receivers to ignore it; not all do. Look at the sender; the stream may carry something else.", ""),
    ("tpkt.garbage", ERROR, PROTOCOL, "Stray bytes between TPKTs.",
     "One side sends something else on the connection, or its framing is wrong. The detail says whether decoding resumed.", ""),
    ("tpkt.bad_length", ERROR, PROTOCOL, "A TPKT states a length that cannot hold a TPDU.",
     "The sender builds invalid TPKT headers; RFC 1006 requires 7 to 65535.", ""),
    ("tpkt.false_length", ERROR, PROTOCOL, "A TPKT length covers other complete TPKTs.",
     "The sender states a wrong length, restarted inside a TPKT, or hides a PDU. The TPKTs inside were decoded as well.", ""),
    ("tpkt.unfinished", NOTE, PROTOCOL, "The capture or the connection ends inside a TPKT.",
     "The last packet of that side is incomplete.", ""),
    ("cotp.malformed", ERROR, PROTOCOL, "A COTP TPDU contradicts itself.",
     "Lengths or types in the COTP header are wrong; the detail names the field, and a PDU behind the header.", ""),
    ("cotp.refused", WARNING, NEGOTIATION, "A COTP connection request was refused.",
     "Check the called TSAP (rack and slot), and whether the device has a free connection resource.", ""),
    ("cotp.disconnected", WARNING, PROTOCOL, "A COTP disconnect request ended the connection.",
     "S7 devices normally just close TCP. A client that disconnects this way with nothing pending is not reported.", ""),
    ("cotp.error", WARNING, PROTOCOL, "A COTP error TPDU rejects a TPDU of the other side.",
     "The detail gives the cause; the error TPDU contains the rejected bytes.", ""),
    ("cotp.repeated_request", ERROR, PROTOCOL, "A second connect request on a connection that is being set up.",
     "Class 0 allows one connect request per TCP connection.", ""),
    ("cotp.answer_without_request", ERROR, PROTOCOL, "A connect confirm without a connect request.",
     "The two sides disagree about which of them opened the connection.", ""),
    ("cotp.bad_start", ERROR, PROTOCOL, "A connection does not begin with a connect request and its confirm.",
     "COTP class 0 allows nothing before that exchange; one side does not implement ISO-on-TCP correctly.", ""),
    ("cotp.bad_confirm", WARNING, NEGOTIATION, "A connect confirm contradicts its connect request.",
     "Reference and TSAPs must match the request; class and size must not exceed it. The detail names the difference.", ""),
    ("cotp.bare_confirm", WARNING, NEGOTIATION, "A client hung up after a connect confirm without TSAPs.",
     "A confirm without them is legal, but some clients insist on both. If this one should stay, have the server repeat them.",
     ""),
    ("cotp.after_disconnect", ERROR, PROTOCOL, "A side keeps sending after its own disconnect request.",
     "The connection ends with the DR; whatever follows is dropped or refused.", ""),
    ("cotp.tpdu_nr", NOTE, PROTOCOL, "A TPDU is numbered, although class 0 does not use numbers.",
     "Most receivers ignore the number; some gateways and simple servers drop such TPDUs. Some client libraries send it.", ""),
    ("cotp.number_unanswered", WARNING, PROTOCOL, "Only requests in numbered TPDUs got no answer.",
     "Some gateways and simple servers drop such TPDUs, as RFC 2126 lets them: have the client send TPDU number 0.", ""),
    ("cotp.fragments_unanswered", WARNING, PROTOCOL, "Only requests that were sent in several TPDUs got no answer.",
     "Simple servers do not join COTP fragments. Ask for a larger TPDU size (1024) in the connect request.", ""),
    ("cotp.empty_dt", NOTE, PROTOCOL, "A server acknowledges requests with an empty DT before it answers them.",
     "Usual for CPs of S7-300/400 and WinAC. A client must skip these 7 bytes and read on. Reported once per connection.", ""),
    ("cotp.size_exceeded", WARNING, NEGOTIATION, "A TPDU is longer than the negotiated TPDU size.",
     "Many receivers take such TPDUs, some drop them or close the connection: ask for a larger size.", ""),
    ("cotp.expedited_too_long", WARNING, PROTOCOL, "Expedited data (ED) exceed 16 bytes.",
     "RFC 1006 allows no more, and S7 uses no expedited data: a faulty sender, or someone tests what the device takes.", ""),
    ("cotp.unfinished_tsdu", WARNING, PROTOCOL, "A message in several COTP fragments was never completed.",
     "The connection or the capture ended, or bytes were lost, before the last fragment.", ""),
    ("cotp.tsdu_too_long", ERROR, PROTOCOL, "A message in COTP fragments exceeded 65536 bytes and was dropped.",
     "S7 devices are not known to send such messages: look for a sender that does not set the end-of-TSDU bit.", ""),
    # IBH-NetLink.
    ("ibh.malformed", ERROR, PROTOCOL, "An IBH-NetLink packet contradicts itself, or stray bytes precede it.",
     "The lengths of its two headers disagree, or the stream carries something else; see the detail.", ""),
    ("ibh.unfinished", NOTE, PROTOCOL, "A message through an IBH-NetLink was never completed.",
     "The connection or the capture ended, or bytes were lost, before its last byte.", ""),
    # S7.
    ("s7.malformed", ERROR, PROTOCOL, "An S7 PDU contradicts itself.",
     "A length, count or type does not fit the data; the detail names the field.", ""),
    ("s7.plus_too_long", NOTE, PROTOCOL, "An S7comm-plus PDU is too long to be kept whole, or holds too many values.",
     "It was paired by its header; what exceeds 8 MiB or 65,536 frames was only counted, and its values were not judged.", ""),
    ("s7plus.malformed", WARNING, PROTOCOL, "The content of an S7comm-plus PDU contradicts itself.",
     "A count, length or end does not fit; the rest is kept as bytes. The sender is faulty, or the format is unknown.", ""),
    ("s7plus.unknown_kind", NOTE, PROTOCOL, "An S7comm-plus PDU holds something of a kind that is not known here.",
     "What precedes it was read; the rest is kept as bytes. Newer devices send such things. Reported once per connection.", ""),
    ("s7plus.notifications_lost", WARNING, FUNCTION, "Numbers of S7comm-plus notifications skip or repeat.",
     "Where they skip, the capture lost some or the PLC did not send them: values are missing. A repeat may be forged.", ""),
    ("s7.unknown_rosctr", WARNING, PROTOCOL, "An S7 PDU has an unknown kind (ROSCTR).",
     "It was counted, but not decoded.", ""),
    ("s7.unknown_code", WARNING, PROTOCOL, "Unknown function, area, syntax or transport size.",
     "Reported once per distinct request: a faulty client, an unknown extension, or someone probing the device.", ""),
    ("s7.odd_address", WARNING, PROTOCOL, "Implausible item address (outside any valid range).",
     "Reported once per distinct request. Devices answer with an error, or return data from an unintended address.", ""),
    ("s7.redundancy_id", NOTE, PROTOCOL, "The redundancy id of an S7 header is not 0.",
     "It is 0 in all known traffic; what receivers do with another value is unknown. Identify the software of the sender.", ""),
    ("s7.client_push", WARNING, PROTOCOL, "A client sent userdata of type indication, which only PLCs send.",
     "A request has type 1: the client is probably faulty. Whether the PLC answered shows in its transaction.", ""),
    ("s7.ack_content", NOTE, PROTOCOL, "An Ack carries parameters or data.",
     "Known devices send an Ack as a header alone. Identify the software of the sender; the packet may be crafted.", ""),
    ("session.data_before_setup", WARNING, NEGOTIATION, "S7 requests were sent before communication was set up.",
     "Setup communication must be the first exchange of a connection; otherwise many PLCs close the connection.", ""),
    ("session.pdu_too_long", ERROR, NEGOTIATION, "An S7 PDU is longer than the negotiated PDU length.",
     "The sender exceeds the granted PDU length; the receiver may refuse or drop the PDU, or close the connection.", ""),
    ("session.repeated_setup", NOTE, NEGOTIATION, "Communication was set up again on the same connection.",
     "Allowed, but it replaces the earlier negotiation; some clients do it to change the PDU length.", ""),
    ("session.read_too_long", WARNING, NEGOTIATION, "A read requests more data than fits in the negotiated PDU length.",
     "Most devices refuse it. The client must split its reads to fit the granted PDU length.", ""),
    ("session.tpdu_too_small", WARNING, NEGOTIATION,
     "The answer to a read fits the PDU length but not the TPDU size, and did not come.",
     "Ask for a TPDU size of 1024 or more in the connect request, or read less at a time.", ""),
    ("session.too_many_jobs", WARNING, NEGOTIATION, "More requests were pending at once than were granted (AmQ).",
     "The client exceeds the granted number of parallel jobs; PLCs then refuse jobs or close the connection.", ""),
    ("session.shared_reference", WARNING, NEGOTIATION, "A client sent a request with the reference of one that is pending.",
     "Several threads of the client share the connection and may mix up answers: give each a connection, or use one lock.", ""),
    ("session.bad_grant", ERROR, NEGOTIATION,
     "A setup answer grants more than was requested, or a PDU length that is too small.",
     "A setup answer may only lower what was requested, and needs room for an answer; clients may fail on this one.", ""),
    ("session.unusual_port", NOTE, PROTOCOL, "S7 communication on a port other than 102.",
     "Gateways, NAT and test benches do this. Suspicious if none of them is configured here: find out who opened the port.",
     ""),
    ("session.idle", NOTE, PROTOCOL, "A connection on port 102 carried only TCP keep-alive probes.",
     "It is open but idle; what it was used for was not captured.", ""),
    ("session.foreign_on_102", NOTE, PROTOCOL, "A protocol other than S7comm and S7comm-plus uses port 102.",
     "It was identified as far as possible and counted, but not decoded.", ""),
    ("session.cut", WARNING, NEGOTIATION, "A connection was closed before all its requests were answered.",
     "Check which side closed it: a server that closes at once lacks the TSAP or a free connection; a client may just give up.",
     ""),
    ("session.encrypted", NOTE, PROTOCOL, "A connection switched to TLS encryption.",
     "Only session keys (--tls-keys) open its content. Where keys did not help, session.tls_closed says why.", ""),
    ("session.tls_closed", WARNING, CAPTURE, "TLS keys were given, but records of a connection could not be decrypted.",
     "What they carried is unknown; the detail says why. Log keys from the session's start, and capture its handshake.", ""),
    ("security.tls_weak", WARNING, SECURITY, "A TLS session uses a version or cipher suite that no longer protects it.",
     "Update the side that supports nothing better: use at least TLS 1.2 with an AEAD suite, preferably TLS 1.3.", ""),
    ("security.certificate_expired", WARNING, SECURITY,
     "A certificate was outside its validity period when it was presented.",
     "Renew it, or set the clock of the device that issued it. Clients that check it refuse the connection.", ""),
    ("security.certificate_weak", WARNING, SECURITY, "A certificate has a weak key or signature.",
     "It can be forged. Issue a new one, with RSA of 2048 bits or an elliptic curve, and SHA-256.", ""),
    # SCD, where bindings say that it is transported.
    ("scd.malformed", ERROR, PROTOCOL, "An SCD message cannot be decoded.",
     "Its size or a value does not fit the dictionary: the binding, the dictionary or the sender is wrong.", ""),
    ("scd.crc", ERROR, PROTOCOL, "The checksum of an SCD message is wrong.",
     "Bytes changed in transit, or the sender computes a different checksum from the one in the dictionary's envelope.", ""),
    ("scd.unknown_object", WARNING, PROTOCOL, "An SCD message names an object or PDO that is not in the dictionary.",
     "Client and device use a different dictionary from this one, or someone is probing addresses.", ""),
    ("scd.access", WARNING, PROTOCOL, "An SCD message violates the access attribute of an object.",
     "A read of a write-only object, a write to a read-only or constant one, or an index that is for reference only.", ""),
    ("scd.garbage", ERROR, PROTOCOL, "Stray bytes between SCD messages in a bound TCP stream.",
     "Something else is sent on this port, or the envelope differs. Decoding resumed at the next message.", ""),
    ("scd.odd_value", NOTE, PROTOCOL, "An SCD message contains something invalid, but was decoded.",
     "Surplus bytes, an infinity, a time out of range, or a different version of the mapping; see the detail.", ""),
    ("scd.status", NOTE, FUNCTION, "A device reports an application status (a positive scd_err_t).",
     "It is not a failure. The dictionary or the device's manual explains the number.", ""),
    ("scd.pdo_error", WARNING, FUNCTION, "A PDO reports an error of its device (a negative scd_err_t).",
     "Its values may be old or invalid. Check the state of the device.", ""),
    ("scd.pdo_gap", WARNING, FUNCTION, "PDOs are missing: their counter skips.",
     "The network or the capture lost them, or the device skipped cycles.", ""),
    ("scd.constant_changed", WARNING, FUNCTION, "A value that the dictionary declares constant has changed.",
     "The device, its firmware or its dictionary at this address was replaced.", ""),
    ("scd.other_dictionary", ERROR, FUNCTION, "A device has a different dictionary from this one.",
     "The detail gives the evidence. Values may be decoded wrongly: compare the files with `s7dissect scd diff`.", ""),
    ("scd.limits", WARNING, FUNCTION, "A value is outside its limits in the dictionary.",
     "The sender ignores the limits, or its dictionary has different ones. Limits apply to the raw value.", ""),
    ("scd.remapped", NOTE, FUNCTION, "The mapping of a PDO was rewritten.",
     "Its payload is decoded by the new mapping from here on. Find out who configures the device.", ""),
    ("scd.bad_mapping", WARNING, FUNCTION, "An invalid PDO mapping was written and accepted.",
     "It was not applied here; PDOs with this number may be decoded wrongly.", ""),
    # Transactions.
    ("transaction.refused", WARNING, FUNCTION, "A request was refused as a whole.",
     "See the error: the device does not know the service, lacks what was requested, protects it, or is in the wrong state.",
     ""),
    ("transaction.item_error", WARNING, FUNCTION, "An item of a read, write or subscription was refused.",
     "Check the address: the block may be missing, too short, protected, optimized (S7-1200/1500), or of a different type.",
     ""),
    ("transaction.bit_count", WARNING, FUNCTION, "An item of several bits was refused: type BIT takes a count of 1.",
     "Read the bytes and take the bits from them, or request one item for each bit.", ""),
    ("transaction.alarm_refused", WARNING, FUNCTION, "An alarm could not be acknowledged, locked or unlocked.",
     "The PLC does not know it, or no longer (gone, or acknowledged elsewhere). Have the client read the alarms again.",
     ""),
    ("transaction.unanswered", WARNING, FUNCTION, "A request got no answer.",
     "The detail gives the reason. If the connection was closed, check which side closed it; if not, check the device's load.",
     ""),
    ("transaction.overdue", WARNING, FUNCTION, "A request has been waiting longer than the limit.",
     "Reported in live analysis while the request is pending; its outcome is reported later. Check the device now.", ""),
    ("transaction.orphan", WARNING, FUNCTION, "An answer has no captured request.",
     "The capture lost the request, it stays encrypted, or the device answers twice or without being asked.", ""),
    ("transaction.slow", WARNING, FUNCTION, "An answer took longer than the limit.",
     "Check the device's cycle load, its communication load setting, and the network path.", ""),
    ("transaction.function_mismatch", ERROR, FUNCTION, "The answer names a different function from the request.",
     "Two requests share a reference, an answer came too late, or the device mixes up its answers.", ""),
    ("transaction.count_mismatch", ERROR, FUNCTION, "The answer has a different number of items from the request.",
     "It may answer a different request (late, or a shared reference), or the device is wrong. Do not trust its values.", ""),
    ("transaction.size_mismatch", ERROR, FUNCTION, "A read item was returned with a different size from the one requested.",
     "It may answer a different request (late, or a shared reference), or the device is wrong. Its bytes are not decoded.", ""),
    ("transaction.odd_data_code", WARNING, FUNCTION,
     "A read item was returned with a transport size that CPUs do not use for it.",
     "Reported once per connection. Clients may misread length and value; simulated PLCs answer this way.", ""),
    ("transaction.write_size", ERROR, FUNCTION, "The data of a write do not have the size of their item.",
     "CPUs refuse such an item with return code 0x07: correct the request of the client.", ""),
    ("transaction.reordered", NOTE, FUNCTION, "The capture shows an answer before its request.",
     "The capture changed the order of packets; the answer time of this transaction is unreliable.", ""),
    ("transaction.table_full", ERROR, FUNCTION, "Too many requests were pending at once; the oldest were dropped.",
     "No known device works this way: this is a flood, or the capture lost the answers.", "denial_of_service"),
    # Operations.
    ("operation.failed", WARNING, OPERATION, "An operation of several steps failed after it had started.",
     "See the step that was refused or reported an error; a partly loaded block is not active.", ""),
    ("operation.unfinished", WARNING, OPERATION, "A transfer stopped before its end.",
     "Check which side ended the connection, then repeat the transfer. After a download the PLC still has the old block.", ""),
    ("operation.upload_unfinished", WARNING, OPERATION, "The upload of a block stopped before its end.",
     "Nothing in the PLC has changed, but the copy is incomplete. Check which side ended the connection; upload again.", ""),
    ("operation.wrong_id", WARNING, OPERATION, "An upload step names an upload ID that the PLC did not assign.",
     "The client mixes up its uploads, or this upload had already ended.", ""),
    ("operation.beyond_end", WARNING, OPERATION, "A transfer continued after its last segment.",
     "The requesting side goes on after the end-of-data flag: check its program and its copy.", ""),
    ("operation.wrong_size", WARNING, OPERATION, "A transfer carried a different amount of data from what was announced.",
     "The data may be damaged. If it is a block, compare it with the project.", ""),
    ("operation.cut_short", WARNING, OPERATION, "A transfer was ended although more data was announced.",
     "The block is incomplete: the client gave up, or ends its transfers too early.", ""),
    ("operation.not_loaded", NOTE, OPERATION, "A client activated a block that was not loaded on this connection.",
     "It was loaded earlier or on another connection, or someone is activating blocks already in the PLC.", ""),
    ("block.not_activated", NOTE, OPERATION, "A client downloaded a block and did not activate it.",
     "The PLC still runs the block it had before. Load the block again, or find out why the client stopped.", ""),
    ("block.differs", WARNING, OPERATION, "An uploaded block differs from the one seen before.",
     "The PLC runs different code from what was loaded into it or read from it: find out who else loads blocks.",
     "modify_program"),
    ("block.changed", WARNING, OPERATION, "A download changes the logic of a block seen before.",
     "Ask who changed the program and why; `s7dissect blocks --diff` shows what is different.", "modify_program"),
    ("block.older", WARNING, OPERATION, "A client replaced a block by an older one.",
     "The code of the download has an earlier time stamp than the block it replaces: an old backup, or a clock that is wrong.",
     ""),
    ("block.inconsistent", WARNING, SECURITY,
     "The tables of a block contradict its code; no known programming tool produces that.",
     "Blocks with injected code look like this. Compare the block with the project, and find out who loaded it.",
     "modify_program"),
    ("block.system_call", WARNING, SECURITY, "A download calls system functions that stop, delete, copy or change something.",
     "The previous version did not, or was not captured. Find out why the program needs them.", "modify_program"),
    ("block.output_write", NOTE, SECURITY, "A download writes outputs that the previous version did not.",
     "Compare with the project; with other findings about blocks, suspect sabotage.", "modify_program"),
    ("block.skipped_call", WARNING, SECURITY, "A download skips calls that the previous version always made.",
     "Monitoring or safety functions may no longer run: compare with `s7dissect blocks --diff`.", "modify_program"),
    ("operation.stray_push", NOTE, OPERATION, "The PLC sends values or messages without a captured subscription.",
     "The capture lacks the subscription, or it had already been cancelled.", ""),
    # Security: events that are normal for some people and an attack by others (reference 7.4).
    ("security.plc_stop", ERROR, SECURITY, "A client sent a PLC stop command.",
     "If the PLC accepted it, the process has stopped; the detail gives the outcome. Identify the host at that address.",
     "operating_mode command_message"),
    ("security.plc_start", ERROR, SECURITY, "A client sent a PLC start command.",
     "A restart sets outputs to their initial state. Identify the host at that address.", "operating_mode restart_shutdown"),
    ("security.stopped", ERROR, SECURITY, "A PLC reports that it went to STOP.",
     "The detail gives the cause if the PLC stated it. If not, look for a stop command, then read the diagnostic buffer.",
     "operating_mode"),
    ("security.mode_changed", NOTE, SECURITY, "A PLC reports a change of operating mode.",
     "Expected after a start command or power-up; suspicious if neither happened.", "operating_mode"),
    ("security.program_change", ERROR, SECURITY, "A client sent a command to load, activate or delete a block.",
     "If this is not your own commissioning, compare the PLC with the project.", "program_download modify_program"),
    ("security.program_read", WARNING, SECURITY, "A client requested the PLC's program.",
     "Expected from your engineering or backup station; from any other host, the program may be stolen.", "program_upload"),
    ("security.memory", ERROR, SECURITY, "A client sent a command to reset, compress or copy PLC memory.",
     "A reset deletes the program; copying to ROM makes a change permanent. Identify the host at that address.",
     "data_destruction modify_program"),
    ("security.protection", ERROR, SECURITY, "A client sent a command to change the protection level or passwords of a PLC.",
     "Expected when a configuration is loaded; by itself it opens the PLC or locks you out. Identify the host at that address.",
     "change_credential"),
    ("security.firmware", ERROR, SECURITY, "A client sent data for the firmware of a PLC.",
     "If you did not update it, take the PLC out of operation and compare its firmware with the manufacturer's.",
     "system_firmware"),
    ("security.force", ERROR, SECURITY, "A client sent test commands that modify or force variables.",
     "A modified value stays until the program writes it; a forced one overrides the program: read the PLC's force table.",
     "manipulate_io_image command_message"),
    ("security.debug", WARNING, SECURITY, "Test functions that slow a PLC down are in use: block status, breakpoints.",
     "They lengthen the cycle; a breakpoint halts the program. Do not use on a running plant.", "monitor_process"),
    ("security.write", WARNING, SECURITY, "A client writes to data blocks, flags or other memory.",
     "Reported once per connection. Expected from an HMI or SCADA server; check any client you do not know as one.",
     "modify_parameter command_message"),
    ("security.write_outputs", ERROR, SECURITY, "A client writes directly to outputs or peripherals.",
     "The written values bypass the PLC program. Reported once per connection. Identify the host at that address.",
     "brute_force_io command_message"),
    ("security.write_refused", WARNING, SECURITY, "A PLC refused a client's write: nothing was written there.",
     "Old addresses, missing rights, or someone probing what can be written. Reported once per connection. Identify the host.",
     "command_message"),
    ("security.new_writer", ERROR, SECURITY, "A client writes to a PLC that a different client wrote to before.",
     "Two masters, a new panel, or an intruder: identify the host at that address.", "rogue_master command_message"),
    ("security.password", WARNING, SECURITY, "A password was sent to a PLC.",
     "The capture contains a recoverable password: keep the file safe.", "valid_accounts network_sniffing"),
    ("security.password_failed", ERROR, SECURITY, "A PLC refused a password.",
     "A typing error, or someone is guessing passwords.", "valid_accounts"),
    ("security.password_guessing", ERROR, SECURITY, "A PLC refused several passwords of one client in a row.",
     "Someone or something is guessing passwords: identify the host at that address.", "valid_accounts"),
    ("security.protected", WARNING, SECURITY, "A PLC refused a request: it is protected, or may be.",
     "If the client is yours: enter the password; on an S7-1200/1500 permit PUT/GET and clear 'optimized block access'.",
     "command_message"),
    ("security.unauthenticated", WARNING, SECURITY, "An S7comm-plus client skipped the authentication that the device offers.",
     "The device carried out its requests all the same: anyone who reaches it can do so. Identify the host at that address.",
     "command_message"),
    ("security.clear_text", NOTE, SECURITY, "An S7comm-plus session in clear text with a PLC whose firmware offers TLS.",
     "Anyone on the network can read the values and see who uses them. Allow only secure PG/PC and HMI communication.",
     "network_sniffing"),
    ("security.session_reused", ERROR, SECURITY, "An S7comm-plus client uses a session that a different connection got.",
     "A session belongs to one connection: recorded requests may be sent again, or someone took over the session.",
     "command_message adversary_in_the_middle"),
    ("security.replay", ERROR, SECURITY, "S7comm-plus requests come out of order: their numbers repeat or go back.",
     "Clients count up by one: recorded requests may be sent again, or someone sends requests in their name.",
     "command_message adversary_in_the_middle"),
    ("security.clock_set", WARNING, SECURITY, "A client set the clock of a PLC.",
     "A wrong time corrupts alarm and log timestamps and triggers time-dependent logic. Compare the new time with yours.",
     "modify_parameter"),
    ("security.reconnaissance", WARNING, SECURITY,
     "A client requested identification, capabilities or the block list of a PLC.",
     "Less suspicious from a known engineering or inventory host; a new host that does this may prepare an attack.",
     "system_information"),
    ("security.flash_led", NOTE, SECURITY, "A client made the PLC's LEDs flash.",
     "Harmless: this is how a technician finds the device in its cabinet.", "system_discovery"),
    ("security.alarm_change", WARNING, SECURITY, "A client locked, unlocked or acknowledged alarms of a PLC.",
     "The PLC does not report a locked alarm. Reported once per connection.", "alarm_suppression"),
    ("security.nc_command", WARNING, SECURITY, "A command was sent to a numerical control.",
     "It can change programs, passwords and tools; the detail names the service.", "command_message"),
    ("security.unknown_service", WARNING, SECURITY, "A client sent an unknown PLC command (PI service, state request).",
     "Its effect is unknown: identify the sender, and check how the PLC reacted.", "command_message"),
    ("security.flood", WARNING, SECURITY, "A connection floods a PLC with messages, or with writes of the same variables.",
     "A client without pauses, or an attempt to keep the PLC busy: identify the program that sends them.", "denial_of_service"),
    ("security.tsap_scan", WARNING, SECURITY, "A client tries one TSAP after another: a scan for racks and slots.",
     "Inventory and engineering tools also scan: suspicious if you run none from this host. Identify it.", "system_discovery"),
    # Devices: facts that stay the same as long as the device is the same.
    ("device.order_number_changed", WARNING, SECURITY, "A device reports a different order number from before.",
     "A different device answers at this address, or a different module in its rack. If nobody replaced it, identify it.",
     "rogue_master"),
    ("device.serial_changed", WARNING, SECURITY, "A device reports a different serial number from before.",
     "The device was replaced, or two devices share the address. If neither is planned, identify it.", "rogue_master"),
    ("device.firmware_changed", WARNING, SECURITY, "A device reports a different firmware version from before.",
     "The firmware was updated, or a different device answers. Compare with your maintenance log.", "system_firmware"),
    ("device.mac_changed", WARNING, SECURITY, "An IP address is used by a different network card from before.",
     "The device was replaced, or a second host uses its address (duplicate address, ARP spoofing): identify both cards.",
     "adversary_in_the_middle"),
    # The analyzer itself.
    ("internal.bug", ERROR, CAPTURE, "The analyzer failed on a packet.",
     "The packet was skipped and the analysis continued. Please report it with the packet.", ""),
)  # fmt: skip

#: The rules by slug.
CATALOGUE: Final[dict[str, Rule]] = {
    slug: Rule(slug, severity, kind, sentence, advice, tuple([TECHNIQUES[key] for key in techniques.split()]))
    for slug, severity, kind, sentence, advice, techniques in _ROWS
}
