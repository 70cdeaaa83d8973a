"""The file that says where SCD is carried: [[binding]] tables in TOML, separate from the dictionary (docs/scd-traffic.md).

``holds`` names the content: messages, or a PDO, struct, variable or object of the dictionary.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from typing import Any, Final, NamedTuple

import msgspec

from dissect.meaning.bindings.binding import Binding, Bindings, Holds
from dissect.meaning.bindings.place import AREAS, Place, in_blocks, parse_place
from dissect.protocols.s7.address import MAX_DB, MAX_OCTET
from dissect.scd.codec import Codec
from dissect.scd.dictionary import Dictionary
from dissect.scd.errors import E_INDEX, E_VALUE, DictionaryError, Error, shown
from dissect.scd.model import NULL, Object, StructType, Variable
from dissect.scd.reading import Table
from dissect.scd.types import MAX_OCTETS
from dissect.scd.user_file import FileError, UserFile, network_of, number_within, read_file
from dissect.wire.config.hints import close_to

MESSAGES: Final = "messages"
_WAYS: Final = f'write "{MESSAGES}", a PDO ("T1"), a struct or object by its name or index, or "object.field"'
_PDO: Final = re.compile(r"[RTrt](?:PDO\s*)?[0-9]+")
_INDEX: Final = re.compile(r"0[xX][0-9a-fA-F]{1,4}")


class Content(NamedTuple):
    """The content of a place; see `Binding` for the fields."""

    holds: Holds
    key: str = ""
    title: str = ""
    address: tuple[int, int] = (0, 0)
    size: int = 0


def find_content(dictionary: Dictionary, written: str) -> Content:
    """Return the content that ``written`` names. Raises `Error` if there is none, if it is ambiguous or has no data."""
    if not written.strip():
        raise Error(E_VALUE, "", f"is empty; {_WAYS}")
    if written == MESSAGES:
        return Content("messages")
    found = [content for content in (_pdo(dictionary, written), _struct(dictionary, written)) if content is not None]
    named = found and found[0].holds == "pdo" and dictionary.pdo(written).name == written
    if not named:
        # A PDO has the name of its mapping object, which can still be named by its index.
        thing = _object(dictionary, written)
        if thing is not None:
            found.append(thing)
    if not found:
        raise _unknown(dictionary, written)
    if len(found) > 1:
        kinds = " and ".join(f"a {content.holds}" for content in found)
        ways = " or ".join(_surely(content) for content in found)
        raise Error(E_VALUE, "", f"{shown(written)} is {kinds}: write {ways}")
    return found[0]


def _surely(content: Content) -> str:
    """Return an unambiguous way to write a content."""
    if content.holds == "pdo":
        return f'"{content.key[0]}PDO {content.key[1:]}"'
    return f'"{content.key}"' if content.holds == "value" else f'"0x{content.address[0]:04x}"'


def _pdo(dictionary: Dictionary, written: str) -> Content | None:
    try:
        pdo = dictionary.pdo(written)
    except Error:
        return None
    key = f"{pdo.direction}{pdo.number}"
    return Content("pdo", key, f"{key} {pdo.name}".rstrip(), (0, 0), pdo.size)


def _struct(dictionary: Dictionary, written: str) -> Content | None:
    by_index = _INDEX.fullmatch(written) and written not in dictionary.names
    index = int(written, 16) if by_index else dictionary.type_names.get(written, -1)
    struct = dictionary.types.get(index)
    if not isinstance(struct, StructType):
        return None
    return Content("struct", struct.name, struct.name, (index, 0), struct.size)


def _object(dictionary: Dictionary, written: str) -> Content | None:
    """Return a whole object or one of its values. Raises `Error` for an object without data, or an unknown sub-index."""
    by_index = _INDEX.fullmatch(written) and written not in dictionary.names
    index = int(written, 16) if by_index else dictionary.names.get(written, -1)
    obj = dictionary.objects.get(index)
    if obj is not None:
        return _whole(obj)
    if by_index:
        return None  # the index of a type, or unknown
    try:
        variable = dictionary.variable(written)
    except Error as error:
        if error.code == E_INDEX:
            return None
        raise
    if variable.index not in dictionary.objects:
        return None
    return _value(variable)


def _whole(obj: Object) -> Content:
    if obj.object_class == NULL:
        raise Error(E_VALUE, "", f"0x{obj.index:04x} {shown(obj.name)} is a NULL, which has no data")
    if obj.single and obj.head is not None:
        return _value(obj.head)
    key = f"0x{obj.index:04x}"
    return Content("object", key, f"{key} {obj.name}".rstrip(), (obj.index, 0), obj.size)


def _value(variable: Variable) -> Content:
    key = f"0x{variable.index:04x}:{variable.sub}"
    return Content("value", key, f"{key} {variable.label}".rstrip(), variable.address, variable.size)


def _unknown(dictionary: Dictionary, written: str) -> Error:
    """Return an error that lists what the dictionary has."""
    if _PDO.fullmatch(written):
        try:
            dictionary.pdo(written)
        except Error as error:
            return error
    within = f"in the dictionary {shown(dictionary.name)}"
    hint = close_to(written, _names(dictionary, written)) or f"; {_WAYS}"
    return Error(E_INDEX, "", f"no PDO, struct or object {shown(written)} {within}{hint}")


def _names(dictionary: Dictionary, written: str) -> Iterator[str]:
    yield MESSAGES
    for kind in dictionary.types.values():
        if isinstance(kind, StructType):
            yield kind.name
    for obj in dictionary:
        if obj.name:
            yield obj.name
        if "." in written:
            for variable in obj:
                yield variable.label


MAX_FILE: Final = 1 << 20
MAX_BINDINGS: Final = 1024
#: The longest TSAP: its parameter has a size of one octet, of which 255 is reserved for extensions.
_MAX_TSAP: Final = 254
_MAX_PORT: Final = 0xFFFF
_MAX_R_ID: Final = 0xFFFFFFFF
_CARRIERS: Final = ("udp", "tcp", "tsap", "s7", "area", "bsend")
#: Carriers whose binding must state the size of a content of variable size.
_SIZED_CARRIERS: Final = ("tcp", "s7")


class BindingError(FileError):
    """A file of bindings that cannot be used."""


def load_bindings(path: str | os.PathLike[str], dictionary: Dictionary) -> Bindings:
    """Return the bindings in a file, for a dictionary. Raises `BindingError`; OSError if the file cannot be read."""
    return read_file(path, lambda text: _parse(text, dictionary), BindingError, MAX_FILE)


def _parse(text: str, dictionary: Dictionary) -> Bindings:
    """Return the bindings in a text. Raises `DictionaryError`, with all faults, each with table, key and line."""
    file = UserFile(text, ("binding",))
    reader = _Reader(dictionary)
    tables = 0
    for table in file.tables("binding", MAX_BINDINGS):
        tables += 1
        with file.troubles:
            reader.add(table)
    file.done()
    if not tables:
        raise DictionaryError("[[binding]]", f"0 bindings, expected 1 to {MAX_BINDINGS}")
    return Bindings([binding for binding, _ in reader.rows])


class _Reader:
    """Reads one table after another; ``rows`` are the bindings, each with its table."""

    def __init__(self, dictionary: Dictionary) -> None:
        self.rows: list[tuple[Binding, Table]] = []
        self._dictionary = dictionary
        self._names: dict[str, Table] = {}
        try:
            self._framed = Codec(dictionary).envelope.framed
        except Error as error:
            raise DictionaryError(f"dictionary {shown(dictionary.name)}, {error.where}", error.detail) from None

    def add(self, table: Table) -> None:
        """Read a table. Raises `DictionaryError`."""
        keys = [key for key in _CARRIERS if table.has(key)]
        if len(keys) != 1:
            told = "one of them is required" if not keys else "exclude each other: use one table for each"
            raise table.fail(", ".join(keys or _CARRIERS[:4] + _CARRIERS[5:]), told)
        binding = _CARRIED[keys[0]](table)
        network = network_of(table, "host")
        content = self._content(table)
        size = self._size(table, binding, content)
        where = f" {network.network_address if network.num_addresses == 1 else network}" if network else ""
        name = table.text("name", binding.name + where)
        device = table.choice("device", ("port", "peer"), "port")
        if binding.carrier == "s7" and device == "peer":
            raise table.fail("device", "an S7 area is in the CPU, which receives the requests")
        table.done()
        binding = msgspec.structs.replace(
            binding, name=name, network=network, device=device,
            holds=content.holds, key=content.key, title=content.title, address=content.address, size=size,
        )  # fmt: skip
        self._check(table, binding)
        self.rows.append((binding, table))
        self._names[name] = table

    def _content(self, table: Table) -> Content:
        try:
            return find_content(self._dictionary, table.text("holds"))
        except DictionaryError:
            raise
        except Error as error:
            raise table.fail("holds", error.detail) from None

    def _size(self, table: Table, binding: Binding, content: Content) -> int:
        """Return the size of the content; 0 if it varies and the carrier has the size."""
        if binding.carrier == "tcp" and content.holds == "messages":
            if not self._framed:
                detail = (
                    "the envelope of this dictionary has no size field, so messages in a TCP stream cannot be separated"
                )
                raise table.fail("holds", detail)
            return 0
        if binding.carrier not in _SIZED_CARRIERS:
            return content.size
        if not table.has("size"):
            if not content.size:
                detail = f"is missing: {shown(table.text('holds'))} has no size of its own; give its size in bytes"
                raise table.fail("size", detail)
            return content.size
        size = number_within(table, "size", 1, MAX_OCTETS)
        if content.size and size != content.size:
            raise table.fail("size", f"{shown(table.text('holds'))} has {content.size} bytes, not {size}")
        return size

    def _check(self, table: Table, binding: Binding) -> None:
        """Raise `DictionaryError` if the name is used already, or another binding claims the same octets."""
        if not binding.name.strip():
            raise table.fail("name", "is empty")
        first = self._names.get(binding.name)
        for other, before in self.rows:
            trouble = _clash(binding, other)
            if trouble:
                raise table.fail(trouble, f"{_told(binding, other)} {before.where}{_at(before)}")
        if first is not None:
            raise table.fail(
                "name",
                f"{shown(binding.name)} is already the name of {first.where}{_at(first)}: choose a different one",
            )
        if binding.carrier == "s7" and binding.offset + binding.size - 1 > MAX_OCTET:
            raise table.fail("size", f"it ends after byte {MAX_OCTET}, the last that an item can address")


def _at(table: Table) -> str:
    return f", line {table.line}" if table.line else ""


def _clash(one: Binding, other: Binding) -> str:
    """Return the key by which two bindings claim the same octets; empty if they do not.

    For the same port, TSAP or R_ID the narrower network is preferred, so that only equal networks conflict. In an S7 area all
    bindings apply.
    """
    if one.carrier != other.carrier:
        return ""
    if one.carrier == "s7":
        same = (one.area, one.db) == (other.area, other.db) and one.overlaps(other)
        apart = one.offset + one.size <= other.offset or other.offset + other.size <= one.offset
        return "s7" if same and not apart else ""
    same = (one.port, one.tsap, one.r_id, one.network) == (other.port, other.tsap, other.r_id, other.network)
    return {"cotp": "tsap"}.get(one.carrier, one.carrier) if same else ""


def _told(one: Binding, other: Binding) -> str:
    if one.carrier != "s7":
        return "is already bound by"
    end = Place(other.area, other.db, other.offset + other.size - 1)
    return f"overlaps bytes that are bound already, {Place(other.area, other.db, other.offset)} to {end} by"


def _udp(table: Table) -> Binding:
    port = number_within(table, "udp", 1, _MAX_PORT)
    return Binding(f"udp {port}", "udp", "messages", port=port)


def _tcp(table: Table) -> Binding:
    port = number_within(table, "tcp", 1, _MAX_PORT)
    return Binding(f"tcp {port}", "tcp", "messages", port=port)


def _bsend(table: Table) -> Binding:
    r_id = number_within(table, "bsend", 0, _MAX_R_ID)
    return Binding(f"BSEND 0x{r_id:08x}", "bsend", "messages", r_id=r_id)


def _tsap(table: Table) -> Binding:
    written = table.content["tsap"]
    table.mark("tsap")
    octets = _tsap_octets(written)
    if octets is None or not 1 <= len(octets) <= _MAX_TSAP:
        detail = f'{shown(written)} is not a TSAP: write 1 to {_MAX_TSAP} bytes as "SCD1", "0x0102" or [1, 2]'
        raise table.fail("tsap", detail)
    text = octets.decode("ascii", "replace")
    shown_as = f'"{text}"' if text.isascii() and text.isprintable() else f"0x{octets.hex()}"
    return Binding(f"TSAP {shown_as}", "cotp", "messages", tsap=octets)


def _tsap_octets(written: Any) -> bytes | None:
    """Return the octets of a text, a hexadecimal text or a list of numbers; None for anything else."""
    if isinstance(written, list):
        numbers = [
            octet for octet in written if isinstance(octet, int) and not isinstance(octet, bool) and 0 <= octet < 256
        ]
        return bytes(numbers) if len(numbers) == len(written) else None
    if not isinstance(written, str) or not written.isascii():
        return None
    if not written.lower().startswith("0x"):
        return written.encode()
    try:
        return bytes.fromhex(written[2:])
    except ValueError:
        return None


def _s7(table: Table) -> Binding:
    written = table.text("s7")
    place = parse_place(written)
    if place is None:
        detail = f'{shown(written)} is not a byte address: write "DB10.DBB0", "MB20", "IB0" or "QB4"'
        raise table.fail("s7", detail)
    return _at_place(place)


def _area(table: Table) -> Binding:
    area = AREAS[table.choice("area", tuple(AREAS))]
    db = number_within(table, "db", 0, MAX_DB) if in_blocks(area) else 0
    return _at_place(Place(area, db, number_within(table, "offset", 0, MAX_OCTET)))


def _at_place(place: Place) -> Binding:
    return Binding(str(place), "s7", "messages", area=place.area, db=place.db, offset=place.offset)


_CARRIED: Final = {"udp": _udp, "tcp": _tcp, "tsap": _tsap, "s7": _s7, "area": _area, "bsend": _bsend}
