"""The catalogue of findings: every slug that can appear, its severity, its sentence and its advice.

Slugs are stable: reports, gates and other people's scripts rely on them. The rules follow reference section 7.
"""

from __future__ import annotations

from typing import Final

from dissect.findings.finding import ERROR, NOTE, WARNING, Rule

_ROWS: Final = (
    # The capture itself.
    ("capture.damaged", WARNING, "The capture file is damaged or cut off.",
     "Everything before the damage was analysed. Copy the file again, or stop the capture cleanly before copying."),
    ("capture.cut_frames", WARNING, "The capture kept only the first part of some packets (snaplen).",
     "Capture again with the full packet length (snaplen 0), or PDUs are only known in part."),
    ("capture.time_backwards", NOTE, "The clock of the capture runs backwards.",
     "Answer times across the step are not reliable; check time synchronisation of the capturing machine."),
    ("capture.one_sided", WARNING, "Only one direction of a connection was captured.",
     "Nothing can be paired here. Check the mirror port: it must copy both directions."),
    # IP and TCP.
    ("ip.fragment_conflict", WARNING, "Overlapping IP fragments carry different octets.",
     "The first copy was kept. This is not normal traffic: look for a faulty device or an attack."),
    ("ip.fragments_evicted", WARNING, "Too many unfinished IP datagrams at once; the oldest were dropped.",
     "Fragments are rare in S7 traffic: look for what sends them."),
    ("stream.hole", WARNING, "Octets of a connection are missing from the capture.",
     "The capture lost packets or was filtered. What was in the hole is unknown; it is not the fault of the devices."),
    ("stream.conflict", WARNING, "A retransmission carries other octets than the first copy.",
     "The first copy was kept. Look for a middlebox that rewrites traffic, or an attack."),
    ("stream.reset_ignored", NOTE, "A TCP reset does not fit the connection and was not believed.",
     "A reset with a wrong sequence number comes from a middlebox or from somebody who guesses."),
    ("stream.reused", NOTE, "A new connection used the same addresses and ports while the old one was still open.",
     "The old connection's end was not captured, or one side restarted without closing it."),
    ("stream.refused", WARNING, "A TCP connection to port 102 was refused.",
     "Nothing listens there: wrong address, the device has no S7 server, it is starting, or a firewall answers for it."),
    ("stream.evicted", WARNING, "Too many connections were open at once; the longest idle ones were dropped.",
     "Requests open on them count as unanswered. Analyse the capture in parts if they matter."),
    ("stream.half_open_evicted", NOTE, "More connection attempts than can be remembered had no answer.",
     "This is what a SYN flood or a port scan looks like."),
    # TPKT and COTP.
    ("tpkt.reserved", WARNING, "The reserved octet of a TPKT header is not 0.",
     "Receivers ignore it; the sender builds its TPKT headers carelessly, or something else is in the stream."),
    ("tpkt.garbage", ERROR, "Octets that belong to no TPKT stand between TPKTs.",
     "One side writes something else into the connection, or its framing is wrong. The next TPKT was searched for."),
    ("tpkt.bad_length", ERROR, "A TPKT states a length that cannot hold a TPDU.",
     "The sender builds wrong TPKT headers; RFC 1006 asks for 7 to 65535."),
    ("tpkt.unfinished", NOTE, "The capture or the connection ends inside a TPKT.",
     "The last packet of that side is not complete."),
    ("cotp.malformed", ERROR, "A COTP TPDU contradicts itself.",
     "Lengths or types in the COTP header are wrong; see the detail for the field."),
    ("cotp.refused", WARNING, "A connection request was refused.",
     "Check the called TSAP (rack and slot), and whether the device has a free connection resource."),
    ("cotp.disconnected", WARNING, "A COTP disconnect request ended the connection.",
     "See the reason it gives; S7 devices normally just close TCP."),
    ("cotp.error", WARNING, "A COTP error TPDU rejects something the other side sent.",
     "See the cause; the rejected octets stand in the TPDU."),
    ("cotp.repeated_request", ERROR, "A second connect request on a connection that is being set up.",
     "Class 0 allows one connect request for each TCP connection."),
    ("cotp.answer_without_request", ERROR, "A connect confirm without a connect request.",
     "The sides disagree about who connects to whom."),
    ("cotp.size_exceeded", WARNING, "A TPDU is longer than the TPDU size that was negotiated.",
     "The sender ignores the negotiated size; some devices drop such TPDUs."),
    ("cotp.unfinished_tsdu", WARNING, "A message in several COTP fragments was never completed.",
     "The connection or the capture ended, or octets were lost, before the last fragment."),
    ("cotp.tsdu_too_long", ERROR, "A message in COTP fragments grew past 65536 octets and was dropped.",
     "No S7 device sends such messages: look for a sender that never sets the end bit."),
    # S7.
    ("s7.malformed", ERROR, "An S7 PDU contradicts itself.",
     "A length, count or type does not fit what is there; see the detail for the field."),
    ("s7.unknown_rosctr", WARNING, "An S7 PDU has a kind (ROSCTR) that nobody knows.",
     "It was counted and left alone."),
    ("session.data_before_setup", WARNING, "S7 requests were sent before communication was set up.",
     "Setup communication must be the first exchange of a connection; many PLCs cut the connection otherwise."),
    ("session.pdu_too_long", ERROR, "An S7 PDU is longer than the PDU length that was negotiated.",
     "The sender ignores the granted PDU length; the other side may drop it or cut the connection."),
    ("session.too_many_jobs", WARNING, "More requests were open at once than were granted (AmQ).",
     "The client sends faster than it may; PLCs then refuse jobs or cut the connection."),
    ("session.bad_grant", ERROR, "A setup answer grants more than was asked for, or a PDU length that is too small.",
     "The answering side negotiates wrongly; clients may fail on it."),
    ("session.unusual_port", NOTE, "S7 communication on a port other than 102.",
     "Normal for gateways, NAT and laboratories; elsewhere find out who opened it."),
    ("session.foreign_on_102", NOTE, "Something other than S7comm speaks on port 102.",
     "It was named as far as it can be told, counted, and not decoded."),
    # Transactions.
    ("transaction.refused", WARNING, "A request was refused as a whole.",
     "See the error code: the service may be unknown to the device, protected, or not possible in its state."),
    ("transaction.item_error", WARNING, "An item of a read or write was refused.",
     "Check the address: the block may be missing or too short, the access protected, the type not allowed."),
    ("transaction.unanswered", WARNING, "A request got no answer.",
     "See the reason. If the connection was cut, look who cut it; if the device stayed silent, look at its load."),
    ("transaction.orphan", WARNING, "An answer came for which no request was seen.",
     "The request was lost from the capture, or a device answers what nobody asked."),
    ("transaction.slow", WARNING, "An answer took longer than the limit.",
     "Look at the device's cycle load, at the communication load setting, and at the network path."),
    ("transaction.function_mismatch", ERROR, "An answer names another function than its request.",
     "The device mixes up its answers, or two requests share a reference."),
    ("transaction.count_mismatch", ERROR, "An answer has another number of items than its request.",
     "The device answers wrongly; its values cannot be assigned with certainty."),
    ("transaction.size_mismatch", ERROR, "A read item came back with another size than was asked for.",
     "The device answers wrongly; the value was not decoded."),
    ("transaction.reordered", NOTE, "The capture shows an answer before its request.",
     "The capture reorders packets; the answer time of that transaction is not reliable."),
    ("transaction.table_full", ERROR, "Too many requests were open at once; the oldest were given up.",
     "No device works so: this is a flood, or answers are missing from the capture."),
    # Ourselves.
    ("internal.bug", ERROR, "The analyzer failed on a packet.",
     "The packet was left out and the analysis went on. Please report it with the packet."),
)  # fmt: skip

#: The rules by slug.
CATALOGUE: Final[dict[str, Rule]] = {
    slug: Rule(slug, severity, sentence, advice) for slug, severity, sentence, advice in _ROWS
}
