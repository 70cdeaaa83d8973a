"""`s7dissect scd decode`: octets into values; shares with `encode` the selectors and the input of octets."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from dissect.cli.formats import format_option, write_outcome
from dissect.cli.main import EXIT_DAMAGED, EXIT_OK
from dissect.cli.scd_files import columns, node_option, open_dictionary
from dissect.meaning.report.formats import OUTCOME, Format
from dissect.meaning.report.outcome import LINE, Outcome, plain
from dissect.meaning.report.styled import Line
from dissect.wire.text import count, encodable, printable

if TYPE_CHECKING:
    from dissect.scd.codec import Codec, Decoded
    from dissect.scd.dictionary import Dictionary
    from dissect.scd.messages import Message
    from dissect.scd.wording import Row

_SCHEMA: Final = "s7dissect.scd-decode/1"
#: The most octets read from a file or pipe: enough for several of the largest messages.
_MOST: Final = 1 << 20
_HEADINGS: Final = ("address", "name", "value", "unit", "raw", "flags")
#: Fields of an envelope shown with a message, where it has them.
_SHOWN_NUMBERS: Final = ("tid", "seq", "src", "dst", "port")

dictionary_option = click.option(
    "-d",
    "--dictionary",
    "path",
    required=True,
    metavar="X",
    type=click.Path(dir_okay=False, readable=False),
    help="The dictionary.",
)


def selectors(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options that select the kind of octets."""
    for option in reversed(
        (
            click.option("--pdo", metavar="T1", help="A PDO, by direction and number, or by name."),
            click.option("--type", "struct", metavar="NAME", help="A struct, by the name of its type."),
            click.option("--object", "whole", metavar="NAME", help="A whole ARRAY or RECORD, by name or index."),
            click.option("--value", metavar="0x6001", help="One variable, as an SDO carries it, by address or name."),
        )
    ):
        command = option(command)
    return command


def only_one(**given: object) -> None:
    """Refuse anything but one selector."""
    names = [f"--{name}" for name in given]
    if sum(bool(value) for value in given.values()) != 1:
        raise click.UsageError(f"Give one of {', '.join(names)}.")


def object_key(text: str) -> int | str:
    """Return an index written as a number, or the name."""
    return int(text, 16) if text[:2] in {"0x", "0X"} and text[2:].isalnum() and _is_hex(text[2:]) else text


@click.command(
    "decode",
    epilog="Exit code: 0 success, 2 wrong use, an unreadable dictionary or undecodable bytes, 3 a damaged message (what can be "
    "read is given), 5 the output could not be written.",
)
@dictionary_option
@node_option
@selectors
@click.option("--message", is_flag=True, help="Messages in their envelope, one after another.")
@click.option("--raw", is_flag=True, help="FILE or - contains raw bytes, not hexadecimal text.")
@click.option("--strict-pad", is_flag=True, help="Report undefined bits that are set.")
@format_option(OUTCOME)
@click.argument("data", nargs=-1, required=True, metavar="HEX...|FILE|-")
def decode_command(
    path: str, pdo: str | None, struct: str | None, whole: str | None, value: str | None, message: bool, raw: bool,
    strict_pad: bool, format_: Format, node: int | None, data: tuple[str, ...],
) -> int:  # fmt: skip
    """Decode bytes: a PDO, a struct, a whole object, one value, or messages.

    The bytes are hexadecimal text in the arguments, in FILE or on standard input (-).
    """
    only_one(pdo=pdo, type=struct, object=whole, value=value, message=message)
    octets = _payload(data, raw)
    from dissect.scd.codec import Codec

    codec = Codec(open_dictionary(path, node=node)[0], strict_pad=strict_pad)
    if message:
        messages = list(codec.parse_messages(octets))
        _tell(codec.dictionary, messages, format_, b"")
        return EXIT_DAMAGED if any(one.error is not None for one in messages) else EXIT_OK
    one, surplus = _decoded(codec, octets, pdo, struct, whole, value)
    _tell(codec.dictionary, [one], format_, surplus)
    return EXIT_OK


# ---- what is given --------------------------------------------------------------------------------------------------


def _is_hex(text: str) -> bool:
    return bool(text) and all(char in "0123456789abcdefABCDEF" for char in text)


def _hex(text: str) -> bytes | None:
    """Return the octets of hexadecimal text with optional spaces, commas, colons, hyphens and 0x; None for other text."""
    words = text.replace(",", " ").replace(":", " ").replace("-", " ").split()
    digits = "".join([word.removeprefix("0x").removeprefix("0X") for word in words])
    return bytes.fromhex(digits) if _is_hex(digits) and len(digits) % 2 == 0 else None


def _payload(data: Sequence[str], raw: bool) -> bytes:
    """Return the octets of the arguments, of the file they name or of standard input."""
    if list(data) != ["-"] and not raw:
        payload = _hex(" ".join(data))
        if payload is not None:
            return payload
        if len(data) != 1 or not Path(data[0]).exists():
            shown = printable(" ".join(data))
            raise click.UsageError(f"{shown}: neither hexadecimal bytes (two digits each) nor a file.")
    if len(data) != 1:
        raise click.UsageError("--raw takes one FILE, or -.")
    if data[0] == "-":
        octets = sys.stdin.buffer.read(_MOST + 1)
    else:
        with Path(data[0]).open("rb") as stream:
            octets = stream.read(_MOST + 1)
    if len(octets) > _MOST:
        raise click.UsageError(f"{printable(data[0])}: more than {_MOST} bytes.")
    if raw:
        return octets
    payload = _hex(octets.decode("ascii", "replace")) if octets.strip() else b""
    if payload is None:
        raise click.UsageError(f"{printable(data[0])}: not hexadecimal text; use --raw for raw bytes.")
    return payload


def _decoded(
    codec: Codec, octets: bytes, pdo: str | None, struct: str | None, whole: str | None, value: str | None
) -> tuple[Message, bytes]:
    """Return the octets decoded as a message without an envelope, and the octets after it; raises `Error`."""
    from dissect.scd.messages import Message

    decoded: Decoded
    if pdo:
        row = codec.pdo(pdo)
        decoded = codec.decode(pdo, octets)
        message = Message(service="pdo", phase="push", pdo=f"{row.direction}{row.number}")
    elif struct:
        decoded, message = codec.decode_type(struct, octets), Message(content=struct)
    elif whole:
        decoded, message = codec.decode_object(object_key(whole), octets), Message(content=whole)
    else:
        assert value is not None
        decoded, message = codec.decode_value(value, octets), Message(content=value)
    message.values, message.flags, message.data = decoded.values, decoded.flags, octets
    message.size = len(octets)
    return message, decoded.surplus


# ---- what is told ---------------------------------------------------------------------------------------------------


def _tell(od: Dictionary, messages: Sequence[Message], format_: Format, surplus: bytes) -> None:
    for message in messages:
        write_outcome(format_, OUTCOME, _Decoding(od, message, surplus))


class _Decoding(Outcome):
    """A message with its values."""

    layout = LINE

    def __init__(self, od: Dictionary, message: Message, surplus: bytes) -> None:
        from dissect.scd.wording import rows

        self._what = od, message, surplus
        self._rows = rows(od, message)

    def text(self) -> Iterator[Line]:
        """Return the message, and its values as a table."""
        table = columns(_table(self._rows)) if self._rows else ()
        return plain([*_heading(*self._what), *table])

    def as_dict(self) -> dict[str, object]:
        """Return message and values."""
        od, message, surplus = self._what
        return _as_dict(od, message, self._rows, surplus)


def _heading(od: Dictionary, message: Message, surplus: bytes) -> Iterator[str]:
    from dissect.scd.wording import subject

    parts = [subject(od, message)]
    if message.numbers:
        parts = [message.phase or "?", *parts]
        parts += [f"{role} {message.numbers[role]}" for role in _SHOWN_NUMBERS if role in message.numbers]
        if "err" in message.numbers:
            parts.append(f"err {message.err} {printable(_error_text(od, message.err))}".rstrip())
    parts.append(count(len(message.data), "byte"))
    yield "  ".join(parts)
    for name, keys in message.flags.items():
        if not keys:
            rest = f": {surplus.hex(' ')}" if name == "trailing" and surplus else ""
            yield f"  odd: {name}{rest}"
    if message.error is not None:
        yield f"  not decoded: {printable(str(message.error))}"
        if message.data:
            yield f"  data: {message.data.hex(' ')}"


def _error_text(od: Dictionary, number: int) -> str:
    return od.errors.get(number, "")


def _table(rows: Sequence[Row]) -> list[list[str]]:
    from dissect.scd.wording import value_text

    lines = [list(_HEADINGS)]
    for row in rows:
        text = f" {printable(row.text)}" if row.text else ""
        lines.append(
            [
                printable(row.address),
                printable(row.name),
                value_text(row.physical) + text,
                printable(row.unit),
                _raw(row),
                ", ".join(row.flags),
            ]
        )
    kept = [number for number in range(len(_HEADINGS)) if number < 3 or any(line[number] for line in lines[1:])]
    return [["  " + line[kept[0]], *[line[number] for number in kept[1:]]] for line in lines]


def _raw(row: Row) -> str:
    """Return a whole number in hexadecimal as on the wire; other values unchanged."""
    value = row.value
    if isinstance(value, bool) or not isinstance(value, int):
        return ""
    decimal = str(value) if row.text or row.physical != value else ""
    if value < 0:
        return decimal
    return f"{decimal} (0x{value:x})" if decimal else f"0x{value:x}"


def _as_dict(od: Dictionary, message: Message, rows: Sequence[Row], surplus: bytes) -> dict[str, object]:
    from dissect.scd.wording import row_json

    has, error = message.numbers, message.error
    return {
        "schema": _SCHEMA,
        "service": message.service or None,
        "phase": message.phase or None,
        "pdo": message.pdo or None,
        "content": encodable(message.content) or None,
        "envelope": has or None,
        "err_text": encodable(_error_text(od, message.err)) if "err" in has else None,
        "values": [
            row_json(row) for row in rows
        ],
        "flags": list(message.flags),
        "data": message.data.hex(),
        "surplus": surplus.hex() or None,
        "error": None if error is None else {
            "code": error.code, "where": encodable(error.where), "detail": encodable(error.detail),
        },
    }  # fmt: skip
