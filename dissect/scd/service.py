"""The three functions of the text (2.3): `init`, `encode`, `decode`, with one codec for the process (R10-R15)."""

from __future__ import annotations

import os

from dissect.scd.codec import Codec
from dissect.scd.dictionary import Dictionary
from dissect.scd.errors import E_COUNT, E_DICTIONARY, E_VALUE, Error
from dissect.scd.layout import Key
from dissect.scd.model import Object, StructType
from dissect.scd.objects import Objects
from dissect.scd.packing import Octets

_codec: Codec | None = None


def init(dictionary: str | os.PathLike[str] | Dictionary) -> Codec:
    """Initialise the codec with a dictionary file (R10, R13) or a dictionary; raises `DictionaryError`, OSError."""
    global _codec  # noqa: PLW0603 - the text describes functions with a state of their own
    if not isinstance(dictionary, Dictionary):
        from dissect.scd.loading import load

        dictionary = load(dictionary)
    _codec = Codec(dictionary)
    return _codec


def encode(objects: Objects) -> bytes:
    """Return the message with these information objects (R14): the PDO, struct, object or variable ``objects.message``."""
    return encode_named(_initialised(), objects)


def decode(octets: Octets, objects: Objects) -> tuple[Key, ...]:
    """Update the information objects from a message (R15) of the kind ``objects.message``; return the keys that changed (C2).

    If ``objects.message`` is empty, the octets are a message in its envelope.
    """
    return decode_named(_initialised(), octets, objects)


def encode_named(codec: Codec, objects: Objects) -> bytes:
    """Do what `encode` does, with another codec. Raises `Error` as `encode` does."""
    name = objects.message
    if not name:
        raise Error(E_VALUE, "encode", "name the PDO, struct, object or variable in objects.message")
    dictionary = codec.dictionary
    if isinstance(dictionary.types.get(dictionary.type_names.get(name, -1)), StructType):
        return codec.encode_type(name, objects)
    if _is_pdo(codec, name):
        return codec.encode(name, objects)
    found = dictionary[name] if name in dictionary else dictionary.variable(name)
    if isinstance(found, Object) and not found.single:
        return codec.encode_object(name, objects)
    at = found[0].address if isinstance(found, Object) else found.address
    if at not in objects:
        raise Error(E_COUNT, name, "no value is given")
    return codec.encode_value(at, objects[at])


def decode_named(codec: Codec, octets: Octets, objects: Objects) -> tuple[Key, ...]:
    """Do what `decode` does, with another codec."""
    name = objects.message
    dictionary = codec.dictionary
    if not name:
        codec.decode_message(octets, objects)
    elif isinstance(dictionary.types.get(dictionary.type_names.get(name, -1)), StructType):
        codec.decode_type(name, octets, objects)
    elif _is_pdo(codec, name):
        codec.decode(name, octets, objects)
    elif (
        name in dictionary
        and isinstance(dictionary[name], Object)
        and not dictionary.objects[dictionary.names[name]].single
    ):
        codec.decode_object(name, octets, objects)
    else:
        codec.decode_value(name, octets, objects)
    return objects.changed


def _is_pdo(codec: Codec, name: str) -> bool:
    try:
        codec.pdo(name)
    except Error:
        return False
    return True


def _initialised() -> Codec:
    if _codec is None:
        raise Error(E_DICTIONARY, "codec", "call init with a dictionary first (R13)")
    return _codec
