"""`s7dissect scd encode`: values into octets."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Final

import click

from dissect.cli.main import EXIT_OK
from dissect.cli.run import write
from dissect.cli.scd_decode import dictionary_option, object_key, only_one, selectors
from dissect.cli.scd_files import WRITING, node_option, open_dictionary

if TYPE_CHECKING:
    from dissect.scd.codec import Codec
    from dissect.scd.dictionary import Dictionary
    from dissect.scd.messages import Phase, Service
    from dissect.scd.model import Variable
    from dissect.scd.types import Value

#: Names for `--message` → service and phase.
_KINDS: Final[dict[str, tuple[Service, Phase]]] = {
    "read": ("read", "request"),
    "read-response": ("read", "response"),
    "read-abort": ("read", "abort"),
    "write": ("write", "request"),
    "write-response": ("write", "response"),
    "write-abort": ("write", "abort"),
    "pdo": ("pdo", "push"),
}
_ADDRESS: Final = re.compile(r"(0[xX][0-9a-fA-F]{1,4})(?:[:.]([0-9]{1,3}))?")
#: Fields of an envelope that can be set by an option, and their meaning.
_NUMBERS: Final = {
    "tid": "number of the transaction",
    "err": "error code, 0 for none",
    "port": "port of the application",
    "src": "source, where the envelope has one",
    "dst": "destination, where the envelope has one",
    "seq": "sequence number, where the envelope has one",
}


def _numbers(command: Callable[..., Any]) -> Callable[..., Any]:
    for name, meaning in reversed(_NUMBERS.items()):
        command = click.option(f"--{name}", type=int, default=0, metavar="N", help=f"With --message: {meaning}.")(
            command
        )
    return command


@click.command("encode", epilog=WRITING)
@dictionary_option
@node_option
@selectors
@click.option("--message", type=click.Choice(list(_KINDS)), help="A message in its envelope; a PDO needs --pdo.")
@_numbers
@click.option("--partial", is_flag=True, help="Use the default, or zero, for values that are not given.")
@click.option("--no-limits", is_flag=True, help="Also encode values outside the limits of the dictionary.")
@click.option("--raw", is_flag=True, help="Write raw bytes instead of hexadecimal text.")
@click.argument("values", nargs=-1, metavar="[VARIABLE=VALUE]...")
def encode_command(
    path: str, pdo: str | None, struct: str | None, whole: str | None, value: str | None, message: str | None,
    partial: bool, no_limits: bool, raw: bool, node: int | None, values: tuple[str, ...], **numbers: int,
) -> int:  # fmt: skip
    """Encode values and write the bytes as hexadecimal text.

    VARIABLE is an address (0x6000:1), a name ("Pump 1.run") or a field of a struct; VALUE is true or false, a number (also 0x…,
    raw:2748, "1374 kPa" with its unit), a name from the dictionary, text, the hexadecimal bytes of a block, an address, or a
    time in ISO 8601 or as "seconds,nanoseconds". With --value, give VALUE alone. A message about one variable takes VARIABLE,
    or VARIABLE=VALUE.
    """
    from dissect.scd.codec import Codec

    if message is None:
        only_one(pdo=pdo, type=struct, object=whole, value=value, message=message)
        if any(numbers.values()):
            raise click.UsageError(f"--{next(name for name in _NUMBERS if numbers[name])} needs --message.")
    elif struct or whole or value or (message == "pdo") != bool(pdo):
        raise click.UsageError("--message pdo needs --pdo; --message takes no other selector.")
    codec = Codec(open_dictionary(path, node=node)[0], limits=not no_limits)
    if message is not None:
        octets = _message(codec, message, pdo, values, numbers, partial)
    elif pdo:
        octets = codec.encode(pdo, _by_address(codec.dictionary, values), partial=partial)
    elif struct:
        octets = _struct(codec, struct, values, partial)
    elif whole:
        octets = _object(codec, whole, values, partial)
    else:
        assert value is not None
        octets = _value(codec, value, values)
    if raw:
        sys.stdout.buffer.write(octets)
        sys.stdout.buffer.flush()
    else:
        write([octets.hex(" ").upper()])
    return EXIT_OK


def _given(words: Sequence[str], find: Callable[[str], Variable]) -> list[tuple[Variable, Value]]:
    """Return the variables and values of VARIABLE=VALUE; a name may contain an equals sign; raises `Error`."""
    from dissect.scd.errors import Error
    from dissect.scd.written import parse_written

    values = []
    for word in words:
        places = [at for at, char in enumerate(word) if char == "="]
        if not places:
            raise click.UsageError(f"expected VARIABLE=VALUE, got {word!r}.")
        refused: Error | None = None
        for at in places:
            try:
                variable = find(word[:at])
            except Error as error:
                refused = refused or error
            else:
                values.append((variable, parse_written(word[at + 1 :], variable)))
                break
        else:
            assert refused is not None
            raise refused
    return values


def _once(pairs: Sequence[tuple[Any, Value]]) -> dict[Any, Value]:
    values = dict(pairs)
    if len(values) != len(pairs):
        raise click.UsageError("a variable was given twice.")
    return values


def _by_address(od: Dictionary, words: Sequence[str]) -> dict[Any, Value]:
    return _once([(variable.address, value) for variable, value in _given(words, od.variable)])


def _struct(codec: Codec, name: str, words: Sequence[str], partial: bool) -> bytes:
    from dissect.scd.errors import E_SUB, Error
    from dissect.scd.model import StructType

    type_ = codec.dictionary.type(name)
    fields = type_.fields if isinstance(type_, StructType) else ()
    known = {field.name: field for field in fields if not field.reserved}

    def find(text: str) -> Variable:
        field = known.get(text.removeprefix(f"{name}."))
        if field is None:
            raise Error(E_SUB, name, f"no field {text!r}")
        return field

    values = _once([(variable.name, value) for variable, value in _given(words, find)])
    return codec.encode_type(name, values, partial=partial)


def _object(codec: Codec, name: str, words: Sequence[str], partial: bool) -> bytes:
    if partial:
        raise click.UsageError("--partial needs --pdo or --type.")
    return codec.encode_object(object_key(name), _by_address(codec.dictionary, words))


def _value(codec: Codec, name: str, words: Sequence[str]) -> bytes:
    from dissect.scd.written import parse_written

    variable = codec.dictionary.variable(name)
    if len(words) != 1:
        raise click.UsageError("--value takes one VALUE.")
    return variable.encode(parse_written(words[0].removeprefix(f"{name}="), variable), limits=codec.limits)


def _message(
    codec: Codec, kind: str, pdo: str | None, words: Sequence[str], numbers: dict[str, int], partial: bool
) -> bytes:
    from dissect.scd.messages import Message

    service, phase = _KINDS[kind]
    message = Message(service=service, phase=phase)
    for name, number in numbers.items():
        setattr(message, name, number)
    if pdo:
        row = codec.pdo(pdo)
        message.pdo = f"{row.direction}{row.number}"
        message.data = codec.encode(pdo, _by_address(codec.dictionary, words), partial=partial)
        return codec.encode_message(message)
    if partial or len(words) != 1:
        raise click.UsageError(f"a {kind} concerns one variable: give VARIABLE, or VARIABLE=VALUE.")
    carries = phase == ("response" if service == "read" else "request")
    if carries and not message.err:
        ((variable, value),) = _given(words, codec.dictionary.variable)
        message.index, message.sub = variable.address
        message.values = {variable.address: value}
    else:
        message.index, message.sub = _address(codec.dictionary, words[0], kind)
    return codec.encode_message(message)


def _address(od: Dictionary, text: str, kind: str) -> tuple[int, int]:
    """Return an address, which the dictionary need not have: it can be requested, and the device may refuse."""
    from dissect.scd.errors import Error

    match = None if text in od.names else _ADDRESS.fullmatch(text)
    if match is None:
        try:
            return od.variable(text).address
        except Error:
            name, equals, _ = text.partition("=")
            if equals and (name in od or _ADDRESS.fullmatch(name)):
                raise click.UsageError(f"a {kind} carries no value: give {name} alone.") from None
            raise
    return int(match[1], 16), int(match[2] or 0)
