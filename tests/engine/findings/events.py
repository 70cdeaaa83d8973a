"""PDUs of functions other than reading and writing: control, transfers, userdata. Octets as the reference states them."""

from __future__ import annotations

from tests.engine.transactions.talk import ack_data, head, job, userdata

REQUEST = 1
RESPONSE = 2
PUSH = 0


def stop(pdu_ref: int) -> bytes:
    """PLC stop."""
    return job(pdu_ref, bytes.fromhex("29000000000009") + b"P_PROGRAM")


def service(pdu_ref: int, name: str, block: bytes = b"") -> bytes:
    """A PI service with its parameter block."""
    head_ = bytes.fromhex("28000000000000fd") + len(block).to_bytes(2, "big")
    return job(pdu_ref, head_ + block + bytes((len(name),)) + name.encode("ascii"))


def blocks(*names: str) -> bytes:
    """The parameter block of _INSE and _DELE."""
    return bytes((len(names), 0)) + "".join(names).encode("ascii")


def texts(*arguments: str) -> bytes:
    """The parameter block of a Sinumerik service: each text with its length, made even."""
    block = b""
    for argument in arguments:
        one = bytes((len(argument),)) + argument.encode("ascii")
        block += one + bytes(len(one) & 1)
    return block


def answered(pdu_ref: int, function: int, code: int = 0) -> bytes:
    """An answer that only has the function."""
    return ack_data(pdu_ref, bytes((function,)), code=code)


def request_download(pdu_ref: int, name: str = "_0A00001P", size: int = 500) -> bytes:
    """The client announces a block."""
    lengths = f"1{size:06d}{size - 100:06d}".encode("ascii")
    return job(pdu_ref, b"\x1a\0\x01\0\0\0\0\0\x09" + name.encode("ascii") + b"\x0d" + lengths)


def download_block(pdu_ref: int, name: str = "_0A00001P") -> bytes:
    """The PLC requests a piece."""
    return job(pdu_ref, b"\x1b\0\0\0\0\0\0\0\x09" + name.encode("ascii"))


def piece(pdu_ref: int, function: int, size: int, more: bool) -> bytes:
    """A piece of a block, in the answer to download block or upload."""
    content = bytes(index & 0xFF for index in range(1, size + 1))
    return ack_data(pdu_ref, bytes((function, int(more))), size.to_bytes(2, "big") + b"\0\xfb" + content)


def download_ended(pdu_ref: int, name: str = "_0A00001P", code: int = 0) -> bytes:
    """The PLC reports that it has everything, or why not."""
    return job(pdu_ref, b"\x1c\0" + code.to_bytes(2, "big") + b"\0\0\0\0\x09" + name.encode("ascii"))


def start_upload(pdu_ref: int, name: str = "_0A00001A") -> bytes:
    """The client requests a block."""
    return job(pdu_ref, b"\x1d\0\0\0\0\0\0\0\x09" + name.encode("ascii"))


def upload_started(pdu_ref: int, upload_id: int = 7, size: int = 300) -> bytes:
    """The PLC gives an id and the size."""
    text = f"{size:07d}".encode("ascii")
    return ack_data(pdu_ref, b"\x1d\0\x01\0" + upload_id.to_bytes(4, "big") + b"\x07" + text)


def upload(pdu_ref: int, upload_id: int = 7) -> bytes:
    """The client requests a piece."""
    return job(pdu_ref, b"\x1e\0\0\0" + upload_id.to_bytes(4, "big"))


def end_upload(pdu_ref: int, upload_id: int = 7) -> bytes:
    """The client has everything."""
    return job(pdu_ref, b"\x1f\0\0\0" + upload_id.to_bytes(4, "big"))


def payload(octets: bytes) -> bytes:
    """The data block of a userdata PDU."""
    return b"\xff\x09" + len(octets).to_bytes(2, "big") + octets if octets else b"\x0a\0\0\0"


def asks(pdu_ref: int, group: int, subfunction: int, octets: bytes = b"", sequence: int = 0) -> bytes:
    """A userdata request; programmer commands always have the long head."""
    code = 0 if group == 1 or sequence else None
    return userdata(pdu_ref, head(REQUEST, group, subfunction, sequence, code), payload(octets))


def tells(
    pdu_ref: int, group: int, subfunction: int, octets: bytes = b"", sequence: int = 0, code: int = 0, part: int = 0
) -> bytes:
    """A userdata answer; ``part`` is its data unit reference: positive if more is to come, negative if it is the last."""
    parameters = bytearray(head(RESPONSE, group, subfunction, sequence, code))
    parameters[8] = abs(part)
    parameters[9] = int(part > 0)
    return userdata(pdu_ref, bytes(parameters), payload(octets))


def bsend(pdu_ref: int, octets: bytes, announced: int = -1, sequence: int = 0, part: int = 0, r_id: int = 1) -> bytes:
    """A BSEND, or a piece of one: ``part`` as in `tells`, ``announced`` the length in front, -1 for none."""
    parameters = bytearray(head(REQUEST, 6, 1, sequence, 0))
    parameters[8] = abs(part)
    parameters[9] = int(part > 0)
    length = announced.to_bytes(2, "big") if announced >= 0 else b""
    octets = b"\x12\x06\x13\x00" + r_id.to_bytes(4, "big") + length + octets
    return userdata(pdu_ref, bytes(parameters), payload(octets))


def pushes(group: int, subfunction: int, octets: bytes, sequence: int = 0) -> bytes:
    """Unsolicited userdata."""
    code = 0 if group in {1, 2} else None
    return userdata(0, head(PUSH, group, subfunction, sequence, code), payload(octets))


def mode(number: int) -> bytes:
    """The push of a mode transition."""
    return userdata(0, b"\x01\0\x10\x10\0\0" + bytes((number, 0)), b"")


def szl(pdu_ref: int, szl_id: int, index: int = 0) -> bytes:
    """A request to read an SZL."""
    return asks(pdu_ref, 4, 1, szl_id.to_bytes(2, "big") + index.to_bytes(2, "big"))


def no_szl(pdu_ref: int, code: int = 0xD401) -> bytes:
    """The answer that this SZL does not exist."""
    return tells(pdu_ref, 4, 1, code=code)


#: A test job: one variable, MW0, with the parameter block of 20 octets.
TEST_JOB = bytes.fromhex("00140008") + bytes(20) + bytes.fromhex("0001020100000000")
#: The same with a value to write.
MODIFY = bytes.fromhex("0014000e") + bytes(20) + bytes.fromhex("0001020100000000") + bytes.fromhex("000400101234")
#: A cyclic request of DB10.DBW4 once a second, and its values.
CYCLIC = bytes.fromhex("00010101") + bytes.fromhex("120a10040001000a84000020")
CYCLIC_VALUES = bytes.fromhex("0001") + bytes.fromhex("ff0400101234")
#: Subscribing to mode transitions, and its end.
SUBSCRIBE = bytes.fromhex("0100") + b"ABCDEFGH"
UNSUBSCRIBE = bytes.fromhex("0000") + b"ABCDEFGH"
PASSWORD = bytes.fromhex("2a3f4c5d6e7f0102")
