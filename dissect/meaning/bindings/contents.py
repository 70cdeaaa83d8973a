"""Decodes the octets of a binding to messages. Bare contents become a `Message` too, so that all SCD has one form."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from dissect.scd.errors import E_LONG, Error
from dissect.scd.messages import Message

if TYPE_CHECKING:
    from dissect.meaning.bindings.binding import Binding
    from dissect.scd.codec import Codec, Decoded

#: Maximum number of messages of one datagram, TSDU, area or block that are decoded.
MAX_MESSAGES: Final = 4096


def decode(codec: Codec, binding: Binding, octets: bytes) -> list[Message]:
    """Decode ``octets`` by the binding. Never raises: a fault becomes the ``error`` of a message, which keeps the ``data``.

    ``service`` is "pdo" for a bare PDO and "content" for other bare contents; their ``phase`` is "push", their ``size`` all
    octets.
    """
    if binding.holds == "messages":
        return _messages(codec, binding, octets)
    message = Message(phase="push", data=octets, size=len(octets))
    if binding.holds == "pdo":
        message.service = "pdo"
        message.pdo = binding.key
    else:
        message.content = binding.title
        message.index, message.sub = binding.address
    try:
        decoded = _bare(codec, binding, octets)
    except Error as error:
        message.error = error
    else:
        message.values = decoded.values
        message.flags = decoded.flags
    return [message]


def _bare(codec: Codec, binding: Binding, octets: bytes) -> Decoded:
    """Return the values of a bare content. Raises `Error`."""
    if binding.holds == "pdo":
        return codec.decode(binding.key, octets)
    if binding.holds == "struct":
        return codec.decode_type(binding.address[0], octets)
    if binding.holds == "object":
        return codec.decode_object(binding.address[0], octets)
    return codec.decode_value(binding.address, octets)


def _messages(codec: Codec, binding: Binding, octets: bytes) -> list[Message]:
    """Return the messages in ``octets``. An S7 area has a fixed size, so zeros may follow its last message."""
    if binding.carrier != "s7" and octets:
        message = codec.parse_message(octets)
        if message.size == len(octets):
            return [message]  # the usual case: one message and nothing else
    found: list[Message] = []
    at, end = 0, len(octets)
    if binding.carrier == "s7" and codec.envelope.opening.strip(b"\0"):
        end = len(octets.rstrip(b"\0"))
    if not end:
        return found
    for message in codec.parse_messages(octets):
        if len(found) == MAX_MESSAGES:
            detail = f"more than {MAX_MESSAGES} messages, the last {len(octets) - at} bytes were not decoded"
            found.append(Message(data=octets[at:], error=Error(E_LONG, "unit", detail)))
            break
        found.append(message)
        at += message.size
        if at >= end:
            break
    return found
