"""Fuzz target ``inputs``: files and texts of users: goldens, dictionaries, bindings, rules, baselines, filters, times.

The first octet chooses the kind of the others (`KINDS`). Only the documented errors may be raised, each with a text; accepted
input can be written and read again.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Final, TypeVar

from benchmarks.scd_damage import sealed
from dissect.files.recording.ring_buffer import parse_limits
from dissect.meaning.bindings.binding import Bindings
from dissect.meaning.bindings.bindings_file import _parse as parse_bindings
from dissect.meaning.bindings.bindings_file import load_bindings
from dissect.meaning.report.slugs import slugs_of
from dissect.meaning.select.window import parse_window
from dissect.online.alerts.loading import parse_rules
from dissect.output.baseline.loading import parse_baseline
from dissect.output.baseline.writing import baseline_toml
from dissect.packets.source.live.filter import NotBuiltInError, compile_filter
from dissect.packets.source.live.reader import LiveError
from dissect.packets.source.packet import CaptureError
from dissect.scd.codec import Codec, Decoded
from dissect.scd.dictionary import Dictionary
from dissect.scd.dump import dump_json, dump_toml
from dissect.scd.eds import import_eds
from dissect.scd.errors import DictionaryError, Error
from dissect.scd.loading import load, load_octets
from dissect.scd.source import parse_json, parse_toml
from dissect.scd.toml_tables import source_text
from dissect.scd.xdd import import_xdd
from dissect.testing.golden.comparison import diff_sessions
from dissect.testing.golden.model import GoldenError, Session
from dissect.testing.golden.parsing import parse_golden
from dissect.testing.golden.writing import EXTRAS, golden_text
from dissect.testing.playback.server.recording import recording_of
from tests.fuzz.checks import check_line, check_lines
from tests.fuzz.played import check_replayed, check_served
from tests.testing.golden.support import WRITTEN

T = TypeVar("T")

PLANT: Final = Path(__file__).resolve().parents[2] / "captures" / "scd" / "plant.toml"
BINDINGS: Final = PLANT.with_name("plant.bind.toml")


@cache
def plant() -> Dictionary:
    """Return the dictionary of captures/scd."""
    return load(PLANT)


@cache
def plant_bindings() -> Bindings:
    """Return the bindings of captures/scd."""
    return load_bindings(BINDINGS, plant())


@cache
def usual() -> Session:
    """Return the session of a golden of every form."""
    return parse_golden(WRITTEN)


def _golden(octets: bytes) -> None:
    given = octets.decode("utf-8", "replace")
    session = parse_golden(given)
    text = golden_text(session, EXTRAS)
    check_lines(text.split("\n"))
    again = parse_golden(text)
    assert golden_text(again, EXTRAS) == text
    for one, other in ((session, usual()), (usual(), session)):
        for difference in diff_sessions(one, other):
            check_line(difference.text)
    if given.replace("\n", "").isprintable():  # others are written escaped, which is another text
        assert not diff_sessions(session, again)
    check_replayed(session)
    check_served(recording_of(session), [], b"")


def _use(found: Dictionary) -> None:
    assert load_octets(found.octets).octets == found.octets
    assert parse_toml(dump_toml(found)).octets == found.octets
    assert parse_json(dump_json(found)).octets == found.octets


def _compiled(octets: bytes) -> None:
    _use(load_octets(sealed(octets)))


def _raw(octets: bytes) -> None:
    _use(load_octets(octets))


def _toml(octets: bytes) -> None:
    _use(parse_toml(source_text(octets, "fuzz.toml"), "fuzz.toml"))


def _json(octets: bytes) -> None:
    _use(parse_json(source_text(octets, "fuzz.json"), "fuzz.json"))


def _eds(octets: bytes) -> None:
    _use(import_eds(octets, "fuzz.eds").dictionary)


def _xdd(octets: bytes) -> None:
    _use(import_xdd(octets, "fuzz.xdd").dictionary)


def _bindings(octets: bytes) -> None:
    parse_bindings(source_text(octets, "fuzz.toml"), plant())


def _rules(octets: bytes) -> None:
    assert parse_rules(source_text(octets, "fuzz.toml"), "fuzz.toml").rules


def _baseline(octets: bytes) -> None:
    baseline = parse_baseline(source_text(octets, "fuzz.toml"))
    text = baseline_toml(baseline)
    check_lines(text.split("\n"))
    assert baseline_toml(parse_baseline(text)) == text


def _filter(octets: bytes) -> None:
    for link_type in (1, 101):
        program = compile_filter(octets.decode("utf-8", "replace"), link_type)
        assert 0 < len(program) <= 4096


def _words(octets: bytes) -> None:
    text = octets.decode("utf-8", "replace")
    for call in (slugs_of, parse_window, lambda words: parse_limits(words.split(","))):
        _refused_or_used(call, text, (ValueError,))


def _received(octets: bytes) -> None:
    """Data from the wire in the envelope of a dictionary: nothing is raised at all."""
    codec = _codec()
    for message in codec.parse_messages(octets):
        assert message.size > 0 or message.error is not None
    codec.envelope.frame(octets, len(octets) // 2)


@cache
def _codec() -> Codec:
    return Codec(plant(), strict_pad=True)


def _decoded(octets: bytes) -> None:
    """The payload of a PDO or of an object: the decoded values can be encoded again."""
    codec = _codec()
    pdos = [f"{pdo.direction}{pdo.number}" for pdo in (*plant().tpdo.values(), *plant().rpdo.values())]
    chosen = octets[0] if octets else 0
    if chosen & 0x80:
        objects = [obj.index for obj in plant() if not obj.single]
        index = objects[chosen % len(objects)]
        _both_ways(octets[1:], lambda made: codec.decode_object(index, made),
                   lambda found: codec.encode_object(index, found.values))  # fmt: skip
    else:
        name = pdos[chosen % len(pdos)]
        _both_ways(octets[1:], lambda made: codec.decode(name, made), lambda found: codec.encode(name, found.values))


def _both_ways(octets: bytes, decode: Callable[[bytes], Decoded], encode: Callable[[Decoded], bytes]) -> None:
    found = decode(octets)
    if not found.flags:
        assert encode(found) == octets


def _refused_or_used(use: Callable[[T], object], given: T, documented: tuple[type[Exception], ...]) -> None:
    """Only a documented error may be raised, with a text."""
    said = "used"
    try:
        use(given)
    except NotBuiltInError:  # only informs its caller that another program must be asked
        assert NotBuiltInError in documented
    except documented as error:
        said = str(error)
    assert said


#: The kind of the octets, and the errors that may be raised for them.
KINDS: Final[tuple[tuple[str, Callable[[bytes], None], tuple[type[Exception], ...]], ...]] = (
    ("golden", _golden, (GoldenError, CaptureError)),  # the latter if nothing in it can be played
    ("compiled", _compiled, (DictionaryError,)),
    ("raw", _raw, (DictionaryError,)),
    ("toml", _toml, (DictionaryError,)),
    ("json", _json, (DictionaryError,)),
    ("eds", _eds, (DictionaryError,)),
    ("xdd", _xdd, (DictionaryError,)),
    ("bindings", _bindings, (DictionaryError,)),  # `load_bindings` makes a BindingError of it
    ("rules", _rules, (DictionaryError,)),  # `load_rules` makes a RuleError of it
    ("baseline", _baseline, (DictionaryError,)),  # `load_baseline` makes a BaselineError of it
    ("filter", _filter, (NotBuiltInError, LiveError)),
    ("words", _words, ()),
    ("received", _received, ()),
    ("decoded", _decoded, (Error,)),
)


def written(kind: str, octets: bytes) -> bytes:
    """Return octets of a kind in the form of this target."""
    return bytes(([name for name, _, _ in KINDS].index(kind),)) + octets


def inputs(octets: bytes) -> None:
    """Any file of a user: it is used, or refused with an error that gives the reason."""
    if not octets:
        return
    _, use, documented = KINDS[octets[0] % len(KINDS)]
    _refused_or_used(use, octets[1:], documented)
