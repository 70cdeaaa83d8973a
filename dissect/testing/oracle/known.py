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
        "The field on the wire holds bits for transport sizes 3, 4 and 5; its bytes are kept as they stand.",
        "6.5, 3.5",
        grounds.length_in_bits,
    ),
    KnownDifference(
        "kept-from-before",
        OURS,
        (LENGTH, TRANSPORT_SIZE),
        "A data item with a return code other than 0x00, 0x0a and 0xff shows transport size and length of the item before.",
        "Wireshark does not read such an item and shows what its variables still hold (0 for the first item).",
        "6.5",
        grounds.kept_from_before,
    ),
    KnownDifference(
        "userdata-type-of-four-bits",
        OURS,
        ("s7comm.param.userdata.type", "s7comm.param.userdata.funcgroup", *SUBFUNCTIONS),
        "Type and function group of userdata are split into four and four bits.",
        "Only two bits of type and six of group make sense of groups 0x20 and 0x3f; newer Wireshark reads them so.",
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
        "Its parameters have a layout of their own: as a length the fourth byte would say 16 where four follow.",
        "4.1, 4.9",
        grounds.mode_transition,
    ),
    KnownDifference(
        "broken-parameter",
        OURS,
        tuple(sorted(facts.NAMES[facts.IN_PARAMETER])),
        "Code and length are shown of a COTP parameter that does not fit into its header.",
        "Without its value, or with a code alone, it is no parameter; we report it as malformed.",
        "2.1",
        grounds.broken_parameter,
    ),
    KnownDifference(
        "usend-as-head",
        OURS,
        tuple(sorted(facts.NAMES[facts.IN_PARAMETERS] | facts.NAMES[facts.IN_DATA] | facts.BODY_NAMES)),
        "The parameters of USEND are shown as those of other userdata, its data as those of a BSEND.",
        "Syntax id 0x13 says that an R_ID stands there; newer Wireshark reads it so.",
        "4.1, 4.10",
        grounds.usend,
    ),
    KnownDifference(
        "parts-joined",
        FORM,
        tuple(sorted(facts.BODY_NAMES)),
        "Nothing is shown of the payload of a part of an answer in several PDUs but the last.",
        "Wireshark shows all of it in the last part, where its bytes are together; there every field is compared.",
        "4.3",
        body_grounds.in_parts,
    ),
    KnownDifference(
        "last-part-alone",
        OURS,
        tuple(sorted(facts.BODY_NAMES)),
        "The last part of an answer in several PDUs, of which no other part was seen, is shown as if it were the whole.",
        "Its data unit reference says that parts came before it; what is left has no head, and its fields are unknown.",
        "4.3",
        body_grounds.last_alone,
    ),
    KnownDifference(
        "time-with-its-century",
        FORM,
        ("s7comm.data.ts",),
        "The time of a clock begins at its reserved byte, two bytes before the DATE_AND_TIME.",
        "The byte between is called the century and is not reliable; the eight behind it are the time.",
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
        "Records of some system status lists are shown as bytes, as those of 0x0232, which are like those of 0x0132.",
        "An extract of a list holds the same records as the list (number in the low byte of the SZL-ID).",
        "4.5",
        body_grounds.records_as_octets,
    ),
    KnownDifference(
        "fill-of-an-item",
        OURS,
        (facts.FILL,),
        "The byte that makes an item of odd size even is not shown behind an address in a request, nor at the end of the"
        " data.",
        "It stands there as it does behind the data of an item, where Wireshark shows it.",
        "3.5",
        body_grounds.fill_of_an_item,
    ),
    KnownDifference(
        "payload-as-octets",
        FORM,
        ("s7comm.data.userdata",),
        "The payload of userdata whose structure is not known has a name.",
        "We keep the same bytes without one.",
        "4.4",
        body_grounds.payload_as_octets,
    ),
    KnownDifference(
        "records-without-names",
        OURS,
        (body_grounds.RECORD_OCTETS,),
        "Records of some system status lists are shown as bytes, and no name is known for any of their fields.",
        "The Siemens manual of system functions describes them.",
        "4.5",
        body_grounds.record_without_names,
    ),
    KnownDifference(
        "address-of-a-record",
        FORM,
        ("s7comm.param.item.length", "s7comm.param.item.db", "s7comm.param.item.address"),
        "Count, DB number and address of an item in the area of data records have names of their own.",
        "Its bytes are the same in every area; our names are those of S7ANY.",
        "3.6",
        body_grounds.data_record,
    ),
    KnownDifference(
        "fill-of-a-record",
        OURS,
        (facts.FILL,),
        "The byte between status and length of a data record that was read is not shown.",
        "The length begins behind it; it says nothing.",
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
        "What AR_SEND pushes is shown as bytes.",
        "It begins with the id of the archive and a length.",
        "4.9",
        body_grounds.archive_data,
    ),
    KnownDifference(
        "argument-of-unknown-service",
        OURS,
        (body_grounds.ARGUMENT,),
        "The argument of a PI service that Wireshark has no name for has a heading and no value.",
        "The bytes before the name of a service are its argument, whatever its name.",
        "3.10",
        body_grounds.argument_unknown,
    ),
    KnownDifference(
        "name-and-its-fields",
        FORM,
        ("s7comm.param.blockcontrol.filename",),
        "The file name of a block is shown whole besides its fields.",
        "Its marker, type, number and file system are compared one by one.",
        "3.9",
        body_grounds.whole_of_fields,
    ),
    KnownDifference(
        "block-with-its-header",
        FORM,
        (facts.CONTENT,),
        "The first piece of a block that is loaded is shown as bytes from its first one.",
        "It begins with the header of the block, whose fields we show before the rest.",
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
        "A parameter or item of a PDU whose lengths or counts contradict each other is shown otherwise, or by one side only.",
        "We report the PDU as malformed and read what its own limits allow; Wireshark reads past them until it fails.",
        "3.1, 3.5",
        grounds.damaged,
    ),
    KnownDifference(
        "credit-of-a-parameter",
        FORM,
        (body_grounds.CREDIT,),
        "The credit in the parameter 0x8c (flow control confirmation) has the name of the credit of an AK.",
        "It is no field of the header; code and length of the parameter are compared, its value we keep as bytes.",
        "2.3",
        body_grounds.credit_of_parameter,
    ),
    KnownDifference(
        "h323",
        SCOPE,
        (WHOLE, *_ALL_OF_TPDU),
        "TPKTs of H.323 (Q.931, H.245) are shown, and nothing of COTP in them.",
        "Wireshark follows the call that names the connection; we do not. Where the first bytes could be COTP (02 70, with"
        " which H.245 begins, an ER), we read them so.",
        "1.4",
        grounds.is_h323,
    ),
    KnownDifference(
        "expedited-refused",
        OURS,
        _ALL_OF_TPDU,
        "The ED of RFC 1006 (LI 2) is not dissected.",
        "RFC 1006 section 6 defines it; Wireshark knows the forms of X.224 only, with LI 4 or 7.",
        "2.2, 6.5",
        grounds.expedited,
    ),
    KnownDifference(
        "reason-refused",
        OURS,
        _ALL_OF_TPDU,
        "A DR whose reason is not in Wireshark's list is not dissected.",
        "An unknown reason is a number like any other; the references are read all the same.",
        "2.4, 6.5",
        grounds.reason,
    ),
    KnownDifference(
        "rejection-refused",
        OURS,
        _ALL_OF_TPDU,
        "An ER with a cause above 3, or longer than LI 8, is not dissected.",
        "The rejected header, which class 0 demands as parameter 0xc1, alone can be longer.",
        "2.3, 2.4",
        grounds.rejection,
    ),
    KnownDifference(
        "malformed-tpdu",
        OURS,
        _ALL_OF_TPDU,
        "Nothing is shown of a TPDU of unknown type, or whose header is too short for its type or longer than its TPKT.",
        "What is there is kept, and reported as malformed.",
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
        "A TPKT header is shown that no TPDU follows.",
        "Its length is below 7, or LI and type behind it are none: on a known connection we report that, skip, and search for"
        " the next TPKT; a connection that begins so is not one of ours.",
        "1.2, 1.3",
        grounds.no_tpdu,
    ),
    KnownDifference(
        "rdp",
        SCOPE,
        (WHOLE, *sorted(facts.NAMES[facts.IN_PARAMETER])),
        "TPKTs of Remote Desktop are dissected, and its negotiation is not a list of parameters.",
        "Such a CR or CC names the connection, whatever its bytes read as parameters would say; it is followed no further. A CC"
        " without negotiation answers such a CR.",
        "1.4",
        grounds.is_rdp,
    ),
    KnownDifference(
        "header-inside-a-message",
        OURS,
        (WHOLE,),
        "A TPKT header is shown that stands in the middle of a TPKT.",
        "Wireshark takes bytes for one behind a segment that it lost. The TPKT around them stands in the stream.",
        "1.3",
        grounds.inside_a_message,
    ),
    KnownDifference(
        "cut",
        SCOPE,
        (WHOLE,),
        "A TPKT is shown of a packet that was not captured whole.",
        "We report the rest of an S7 PDU as cut, and skip the rest of other TPDUs.",
        "5.5",
        grounds.cut_frame,
    ),
    KnownDifference(
        "lost-by-tcp",
        OURS,
        (WHOLE,),
        "A message is not shown: its segment was taken for a retransmission (an answer captured after its own acknowledgement),"
        " came out of order, or stood behind bytes that fit no TPKT.",
        "It stands in the TCP stream, in its order, as tshark's own sequence numbers and payloads put together show.",
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
        "A message behind missing bytes is shown in its own packet, and by us in the later one that brought those bytes.",
        "Nobody can read what follows a gap before it is closed; what is sent again closes it behind packets captured earlier.",
        "5.5",
        grounds.closes_a_gap,
    ),
    KnownDifference(
        "shown-where-sent-again",
        OURS,
        (FRAME,),
        "A message is shown only where it was sent again.",
        "An earlier packet brought all of it (shown on tshark's own sequence numbers).",
        "5.5",
        grounds.shown_in_a_retransmission,
    ),
    KnownDifference(
        "joined-over-a-gap",
        OURS,
        (WHOLE,),
        "Parts of two messages in several DTs are joined over missing bytes to a PDU that nobody sent.",
        "What a gap took a part of is given up: its end cannot be known.",
        "2.5, 5.5",
        grounds.joined_over_a_gap,
    ),
    KnownDifference(
        "parameter-of-an-ack",
        OURS,
        tuple(sorted(facts.NAMES[facts.IN_PARAMETERS])),
        "Nothing is shown of the parameters of an Ack.",
        "An Ack has none by rule, but what its header counts as parameters is there and is shown (`s7.ack_content`).",
        "3.1",
        grounds.parameter_of_ack,
    ),
    KnownDifference(
        "unfinished",
        OURS,
        (WHOLE, FRAME),
        "Behind a message that Wireshark calls malformed, one that the segment holds only the beginning of is shown as it is.",
        "It is whole when the next segment has come; what one message holds does not change where the next one ends.",
        "1.1, 1.3",
        grounds.unfinished,
    ),
    KnownDifference(
        "shown-again",
        OURS,
        (WHOLE,),
        "What was sent again is dissected again, where Wireshark does not take its segment for a retransmission.",
        "Earlier segments brought every byte of it (shown on tshark's own sequence numbers): a PDU counts once.",
        "5.5",
        grounds.brought_before,
    ),
)
