"""The understood differences: for each the two readings, the octets that decide, and which side is right.

This is the only place where a difference may be excused. An entry (`dissect.testing.oracle.entry`) names the field, and its
predicate
(`dissect.testing.oracle.grounds`, `body_grounds`) says exactly when it applies. A difference without an entry is unexplained,
and the
tests fail. ``side`` is `OURS` if our reading is right, `SCOPE` if the package leaves something out on purpose, `FORM` if both
are equal in meaning. docs/oracle.md shows this table.
"""

from __future__ import annotations

from typing import Final

from dissect.testing.oracle import body_grounds, facts, grounds
from dissect.testing.oracle.entry import KnownDifference
from dissect.testing.oracle.grounds import FRAME, LENGTH, OCTETS, SUBFUNCTIONS, TRANSPORT_SIZE, WHOLE, Case

OURS: Final = "Ours is right"
SCOPE: Final = "Left out on purpose"
FORM: Final = "The same in another form"

#: The missing fields if Wireshark shows nothing of a TPDU.
_ALL_OF_TPDU: Final = (OCTETS, *sorted(facts.NAMES[facts.IN_TPDU] | facts.NAMES[facts.IN_PARAMETER]))


def explain(case: Case) -> str:
    """Return the id of the entry that explains a difference, empty if none does."""
    for entry in KNOWN:
        if case.place.name in entry.names and entry.applies(case):
            return entry.id
    return ""


def as_markdown() -> str:
    """Return the table as Markdown for docs/oracle.md."""
    lines = ["| id | Wireshark | who is right, and why | reference |", "|---|---|---|---|"]
    lines += [f"| `{entry.id}` | {entry.what} | {entry.side}. {entry.why} | {entry.reference} |" for entry in KNOWN]
    return "\n".join(lines) + "\n"


KNOWN: Final = (
    KnownDifference(
        "length-in-octets",
        OURS,
        (LENGTH,),
        "`s7comm.data.length` of a data item that counts bits is shown in bytes.",
        "On the wire the length counts bits for transport sizes 3, 4 and 5; we show it as it is.",
        "6.5, 3.5",
        grounds.length_in_bits,
    ),
    KnownDifference(
        "kept-from-before",
        OURS,
        (LENGTH, TRANSPORT_SIZE),
        "A data item with a return code other than 0x00, 0x0a and 0xff is shown with the transport size and length of "
        "the item before it.",
        "Wireshark does not read such an item and shows what its variables still hold (0 for the first item).",
        "6.5",
        grounds.kept_from_before,
    ),
    KnownDifference(
        "userdata-type-of-four-bits",
        OURS,
        ("s7comm.param.userdata.type", "s7comm.param.userdata.funcgroup", *SUBFUNCTIONS),
        "Type and function group of userdata are split into four and four bits.",
        "Groups 0x20 and 0x3f make sense only with two bits of type and six of group; newer Wireshark reads them like this.",
        "4.1, 6.5",
        grounds.split_in_fours,
    ),
    KnownDifference(
        "mode-transition-as-head",
        OURS,
        (
            "s7comm.param.item.varspec",
            "s7comm.param.item.varspec_length",
            "s7comm.param.item.syntaxid",
            "s7comm.param.userdata.type",
            "s7comm.param.userdata.funcgroup",
            "s7comm.param.userdata.seq_num",
        ),
        "The mode transition push is shown with the parameter head of other userdata.",
        "Its parameters have a layout of their own: read as a length, the fourth byte would be 16, but only four bytes follow.",
        "4.1, 4.9",
        grounds.mode_transition,
    ),
    KnownDifference(
        "broken-parameter",
        OURS,
        tuple(sorted(facts.NAMES[facts.IN_PARAMETER])),
        "A COTP parameter that does not fit into its header is shown with code and length.",
        "Without a value, or with only a code, it is not a parameter; we report it as malformed.",
        "2.1",
        grounds.broken_parameter,
    ),
    KnownDifference(
        "usend-as-head",
        OURS,
        tuple(sorted(facts.NAMES[facts.IN_PARAMETERS] | facts.NAMES[facts.IN_DATA] | facts.BODY_NAMES)),
        "The parameters of USEND are shown as those of other userdata, its data as those of a BSEND.",
        "Syntax id 0x13 means that an R_ID follows; newer Wireshark reads it like this.",
        "4.1, 4.10",
        grounds.usend,
    ),
    KnownDifference(
        "parts-joined",
        FORM,
        tuple(sorted(facts.BODY_NAMES)),
        "Of an answer in several PDUs, only the last part is shown with its payload.",
        "Wireshark shows the joined payload of all parts in the last one; every field is compared there.",
        "4.3",
        body_grounds.in_parts,
    ),
    KnownDifference(
        "last-part-alone",
        OURS,
        tuple(sorted(facts.BODY_NAMES)),
        "If only the last part of an answer in several PDUs was captured, it is shown as if it were the whole answer.",
        "Its data unit reference shows that other parts came before it; the rest has no head, so its fields are unknown.",
        "4.3",
        body_grounds.last_alone,
    ),
    KnownDifference(
        "time-with-its-century",
        FORM,
        ("s7comm.data.ts",),
        "The time of a clock begins at its reserved byte, two bytes before the DATE_AND_TIME.",
        "The byte between them is called the century and is not reliable; the eight bytes after it are the time.",
        "4.12",
        body_grounds.longer_time,
    ),
    KnownDifference(
        "count-with-its-reserved-octet",
        FORM,
        ("s7comm.param.itemcount",),
        "The item count of cyclic services begins at the reserved byte before it.",
        "The byte between head and count is 0 in captures; the count has one byte, as everywhere else.",
        "4.7",
        body_grounds.longer_count,
    ),
    KnownDifference(
        "records-as-octets",
        OURS,
        tuple(sorted(name for name in facts.BODY_NAMES if "szl" in name)),
        "Records of some system status lists are shown as bytes, for example those of 0x0232, which are like those of 0x0132.",
        "An extract of a list holds the same records as the list (number in the low byte of the SZL-ID).",
        "4.5",
        body_grounds.records_as_octets,
    ),
    KnownDifference(
        "fill-of-an-item",
        OURS,
        (facts.FILL,),
        "The fill byte after an item of odd size is not shown if it follows an address in a request or is at the end of "
        "the data.",
        "It is there, as after the data of an item, where Wireshark does show it.",
        "3.5",
        body_grounds.fill_of_an_item,
    ),
    KnownDifference(
        "payload-as-octets",
        FORM,
        ("s7comm.data.userdata",),
        "Userdata payload of unknown structure has a name.",
        "We keep the same bytes without a name.",
        "4.4",
        body_grounds.payload_as_octets,
    ),
    KnownDifference(
        "records-without-names",
        OURS,
        (body_grounds.RECORD_OCTETS,),
        "Records of some system status lists are shown as bytes, and no name is known for any of their fields.",
        "Our field names follow the Siemens manual of system functions.",
        "4.5",
        body_grounds.record_without_names,
    ),
    KnownDifference(
        "address-of-a-record",
        FORM,
        ("s7comm.param.item.length", "s7comm.param.item.db", "s7comm.param.item.address"),
        "For an item in the area of data records, count, DB number and address have names of their own.",
        "An item has the same bytes in every area; our names are those of S7ANY.",
        "3.6",
        body_grounds.data_record,
    ),
    KnownDifference(
        "fill-of-a-record",
        OURS,
        (facts.FILL,),
        "The byte between status and length of a data record that was read is not shown.",
        "The length begins after it; the byte has no meaning.",
        "4.7",
        body_grounds.fill_before_length,
    ),
    KnownDifference(
        "archives-as-reserved",
        OURS,
        tuple(sorted(facts.BODY_NAMES)),
        "The list of archives of a message service is shown as reserved bytes.",
        "With an alarm type of AR_SEND, the number of archives and their ids (or return codes) follow.",
        "4.9",
        body_grounds.archives,
    ),
    KnownDifference(
        "archive-as-octets",
        OURS,
        tuple(sorted(facts.BODY_NAMES)),
        "The data that AR_SEND pushes are shown as bytes.",
        "They begin with the id of the archive and a length.",
        "4.9",
        body_grounds.archive_data,
    ),
    KnownDifference(
        "argument-of-unknown-service",
        OURS,
        (body_grounds.ARGUMENT,),
        "If Wireshark has no name for a PI service, its argument is shown as a heading without a value.",
        "The bytes before the name of a service are its argument, whatever its name.",
        "3.10",
        body_grounds.argument_unknown,
    ),
    KnownDifference(
        "name-and-its-fields",
        FORM,
        ("s7comm.param.blockcontrol.filename",),
        "The file name of a block is shown as a whole, in addition to its fields.",
        "We compare its marker, type, number and file system one by one.",
        "3.9",
        body_grounds.whole_of_fields,
    ),
    KnownDifference(
        "block-with-its-header",
        FORM,
        (facts.CONTENT,),
        "The first piece of a block that is loaded is shown as bytes from its beginning.",
        "It begins with the header of the block; we show the fields of the header, then the rest.",
        "4.6",
        body_grounds.block_header,
    ),
    KnownDifference(
        "damaged-pdu",
        FORM,
        tuple(
            sorted(
                facts.NAMES[facts.IN_PARAMETERS]
                | facts.NAMES[facts.IN_ITEM]
                | facts.NAMES[facts.IN_DATA_ITEM]
                | facts.BODY_NAMES
            )
        ),
        "In a PDU whose lengths or counts contradict each other, a parameter or item is shown differently, or by one "
        "side only.",
        "We report the PDU as malformed and read only within its limits; Wireshark reads past them until it fails.",
        "3.1, 3.5",
        grounds.damaged,
    ),
    KnownDifference(
        "credit-of-a-parameter",
        FORM,
        (body_grounds.CREDIT,),
        "The credit in the parameter 0x8c (flow control confirmation) has the same name as the credit of an AK.",
        "It is not a field of the header. Code and length of the parameter are compared; we keep its value as bytes.",
        "2.3",
        body_grounds.credit_of_parameter,
    ),
    KnownDifference(
        "h323",
        SCOPE,
        (WHOLE, *_ALL_OF_TPDU),
        "TPKTs of H.323 (Q.931, H.245) are shown without COTP fields.",
        "Wireshark follows the call that names the connection; we do not. If the first bytes could be COTP (H.245 "
        "begins with 02 70, which is also an ER), we read them as COTP.",
        "1.4",
        grounds.is_h323,
    ),
    KnownDifference(
        "expedited-refused",
        OURS,
        _ALL_OF_TPDU,
        "The ED of RFC 1006 (LI 2) is not dissected.",
        "RFC 1006 section 6 defines it; Wireshark knows only the forms of X.224, with LI 4 or 7.",
        "2.2, 6.5",
        grounds.expedited,
    ),
    KnownDifference(
        "reason-refused",
        OURS,
        _ALL_OF_TPDU,
        "A DR whose reason is not in Wireshark's list is not dissected.",
        "An unknown reason is still a number, and the references can be read.",
        "2.4, 6.5",
        grounds.reason,
    ),
    KnownDifference(
        "rejection-refused",
        OURS,
        _ALL_OF_TPDU,
        "An ER with a cause above 3, or longer than LI 8, is not dissected.",
        "The rejected header alone, which class 0 requires as parameter 0xc1, can be longer.",
        "2.3, 2.4",
        grounds.rejection,
    ),
    KnownDifference(
        "malformed-tpdu",
        OURS,
        _ALL_OF_TPDU,
        "A TPDU is not shown if its type is unknown, or its header is too short for the type or longer than the TPKT.",
        "We keep the bytes, and report the TPDU as malformed.",
        "1.2, 2.1",
        grounds.contradictory,
    ),
    KnownDifference(
        "size-of-65531",
        OURS,
        (facts.TPDU_SIZE,),
        "TPDU size code 0x10 is shown as 1.",
        "Wireshark masks the code with 0x0f; RFC 1006 stacks mean 65531 bytes.",
        "2.3, 6.5",
        grounds.size_of_65531,
    ),
    KnownDifference(
        "size-without-meaning",
        FORM,
        (facts.TPDU_SIZE,),
        "A TPDU size code below 7 or above 16, or one of several bytes, is shown as a power of two.",
        "X.224 gives it no meaning, so we state no size.",
        "2.3",
        grounds.no_size,
    ),
    KnownDifference(
        "header-without-tpdu",
        OURS,
        (WHOLE,),
        "A TPKT header without a TPDU after it is shown.",
        "Its length is below 7, or LI and type after it are not valid. On a known connection we report that, skip it "
        "and search for the next TPKT; a connection that begins like this is not ISO-on-TCP.",
        "1.2, 1.3",
        grounds.no_tpdu,
    ),
    KnownDifference(
        "rdp",
        SCOPE,
        (WHOLE, *sorted(facts.NAMES[facts.IN_PARAMETER])),
        "TPKTs of Remote Desktop are dissected, and its negotiation is not a list of parameters.",
        "A CR or CC with this negotiation identifies the connection as RDP, even if its bytes could be read as "
        "parameters; we do not follow it further. So does a CC without negotiation that answers a CR of this kind.",
        "1.4",
        grounds.is_rdp,
    ),
    KnownDifference(
        "header-inside-a-message",
        OURS,
        (WHOLE,),
        "A TPKT header in the middle of a TPKT is shown.",
        "After a segment that Wireshark lost, it takes other bytes for a TPKT header. The stream contains the TPKT "
        "around them.",
        "1.3",
        grounds.inside_a_message,
    ),
    KnownDifference(
        "cut",
        SCOPE,
        (WHOLE,),
        "A TPKT in a packet that was captured only in part is shown.",
        "We report the rest of an S7 PDU as cut, and skip the rest of other TPDUs.",
        "5.5",
        grounds.cut_frame,
    ),
    KnownDifference(
        "lost-by-tcp",
        OURS,
        (WHOLE,),
        "A message is not shown: its segment was taken for a retransmission (an answer captured after its own acknowledgement),"
        " came out of order, or followed bytes that fit no TPKT.",
        "The TCP stream contains it at this place, as a stream built from tshark's own sequence numbers and payloads shows.",
        "1.3, 5.5",
        grounds.lost_by_tcp,
    ),
    KnownDifference(
        "shown-at-the-gap",
        OURS,
        (FRAME,),
        "With `--reorder`, a message that arrived before bytes ahead of it is shown in the packet that brought those bytes.",
        "Its own bytes are in an earlier packet, and the time of that packet is when they were on the wire.",
        "5.5",
        grounds.shown_at_the_gap,
    ),
    KnownDifference(
        "shown-before-the-gap-closed",
        FORM,
        (FRAME,),
        "A message after missing bytes is shown in its own packet; we show it in the later packet that brought those bytes.",
        "A receiver cannot read what follows a gap until a retransmission closes it, after packets that were captured earlier.",
        "5.5",
        grounds.closes_a_gap,
    ),
    KnownDifference(
        "shown-where-sent-again",
        OURS,
        (FRAME,),
        "A message is shown only in the packet that sent it again.",
        "An earlier packet brought all of it (as tshark's own sequence numbers show).",
        "5.5",
        grounds.shown_in_a_retransmission,
    ),
    KnownDifference(
        "joined-over-a-gap",
        OURS,
        (WHOLE,),
        "Parts of two messages in several DTs are joined across missing bytes into a PDU that was never sent.",
        "We give up a message that lost a part in a gap, because its end cannot be known.",
        "2.5, 5.5",
        grounds.joined_over_a_gap,
    ),
    KnownDifference(
        "parameter-of-an-ack",
        OURS,
        tuple(sorted(facts.NAMES[facts.IN_PARAMETERS])),
        "The parameters of an Ack are not shown.",
        "By the rules an Ack has none, but we show what its header counts as parameters (`s7.ack_content`).",
        "3.1",
        grounds.parameter_of_ack,
    ),
    KnownDifference(
        "unfinished",
        OURS,
        (WHOLE, FRAME),
        "After a message that Wireshark calls malformed, a message of which the segment has only the beginning is shown "
        "incomplete.",
        "The next segment completes it; the contents of one message do not change where the next one ends.",
        "1.1, 1.3",
        grounds.unfinished,
    ),
    KnownDifference(
        "shown-again",
        OURS,
        (WHOLE,),
        "A message that was sent again is dissected again if Wireshark does not take its segment for a retransmission.",
        "Earlier segments brought every byte of it (as tshark's own sequence numbers show), and a PDU counts once.",
        "5.5",
        grounds.brought_before,
    ),
)
