"""Objects leave the process: every public class copies, deep-copies and pickles, in the compiled and the interpreted build."""

from __future__ import annotations

import ast
import copy
import functools
import inspect
import json
import multiprocessing
import os
import pickle
import pydoc
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, Final

import pytest

import dissect
from dissect.engine.transactions.old_names import OldNames
from dissect.engine.transactions.transaction import OUTCOMES
from dissect.online.live import iterating
from dissect.wire.attribute_tables import ATTRIBUTES
from dissect.wire.layout import Layout
from tests.test_sources import Line

CAPTURES: Final = Path(__file__).parents[1] / "captures"
PLANT: Final = CAPTURES / "scd" / "plant.toml"
#: Captures that together hold events of every class, and sessions of every protocol.
FILES: Final = ("item-errors.pcapng", "crafted/coverage-userdata.pcapng", "nodes7-poll-missing.pcapng")


@functools.cache
def events() -> list[Any]:
    """Events of each public class, the first ones of each."""
    found: list[Any] = []
    for name in FILES:
        found += dissect.open(CAPTURES / name)
    for path in sorted(CAPTURES.rglob("*plus*.pcapng"))[:3]:
        found += dissect.open(path)
    found += dissect.open(PLANT.with_suffix(".pcapng"), scd=PLANT, bind=PLANT.with_suffix(".bind.toml"))
    return found


def of(kind: type) -> list[Any]:
    return [event for event in events() if type(event) is kind][:40]


def blocks() -> Iterable[Any]:
    for path in sorted(CAPTURES.rglob("*.pcapng")):
        yield from dissect.blocks(path)


class Acts(dissect.Observer):
    """Keeps what clients did."""

    def __init__(self) -> None:
        super().__init__()
        self.acts: list[dissect.Act] = []

    def act(self, act: dissect.Act) -> None:
        self.acts.append(act)


def acts() -> list[dissect.Act]:
    """Acts of control and of transfers."""
    observer = Acts()
    dissect.Run([CAPTURES / "plc-control.pcapng", CAPTURES / "transfer.pcapng"], observer).read()
    return observer.acts


#: Objects of each public class: a function, called late, because reading takes time.
MADE: Final[dict[str, Callable[[], list[Any]]]] = {
    "Act": acts,
    "Analysis": lambda: [dissect.analyze(CAPTURES / name) for name in FILES],
    "CarvedBlock": lambda: [block for block, _ in zip(blocks(), range(5), strict=False)],
    "Connection": lambda: of(dissect.Connection),
    "Device": lambda: list(dissect.devices(CAPTURES / FILES[0])),
    "Finding": lambda: of(dissect.Finding),
    "Observer": lambda: [dissect.Observer()],
    "Operation": lambda: of(dissect.Operation),
    "Options": lambda: [dissect.Options(slow_ns=5)],
    "Pdu": lambda: of(dissect.Pdu),
    "Pipeline": lambda: [dissect.analyze(CAPTURES / FILES[0]).pipeline],
    "PlusPdu": lambda: of(dissect.PlusPdu),
    "ScdMessage": lambda: of(dissect.ScdMessage),
    "Transaction": lambda: of(dissect.Transaction),
    "TransactionError": lambda: [error for one in of(dissect.Transaction) for error in one.errors],
    "TransactionItem": lambda: [item for one in of(dissect.Transaction) for item in one.items],
    "ValueRow": lambda: list(dissect.values(CAPTURES / FILES[0]))[:20],
    "Where": lambda: [dissect.Where('function contains "Read" and not error.code', also=["latency > 1 ms"])],
}
#: Old names of a transaction, which warn.
OLD: Final = frozenset(name for name in vars(OldNames) if not name.startswith("_"))
#: Public classes that are not made, or hold an open file.
NO_COPIES: Final = frozenset(("Run",))


def classes() -> set[str]:
    named = {name: getattr(dissect, name) for name in dissect._PUBLIC}
    return {name for name, value in named.items() if isinstance(value, type) and not issubclass(value, Exception)}


def test_the_contract_names_every_public_class() -> None:
    assert set(MADE) | NO_COPIES == classes()


def said(found: Any) -> object:
    """What an object says of itself, in plain values."""
    if isinstance(found, dissect.Analysis):
        return found.as_dict(), [repr(one) for one in found.slowest()]
    if isinstance(found, dissect.Transaction):
        texts = (OUTCOMES[found._outcome], found.reason_text, found.function_name, found.certainty)
        plus = [(item.label, repr(item.value)) for item in found.plus_results] if found.is_plus else []
        results = [(repr(one), one.value, one.return_code) for one in found.s7_results]
        return (
            texts,
            found.latency_ns,
            found.frames,
            results,
            plus,
            [repr(one) for one in found.errors],
            said(found.connection),
        )
    if isinstance(found, dissect.Connection):
        ending = found.ending
        ends = (str(found.client), str(found.server), found.tsap_called and found.tsap_called.octets)
        return repr(found), ends, found.pdus, ending and (ending.how, ending.deed(found), ending.silence_ns)
    if isinstance(found, (dissect.Pdu, dissect.PlusPdu)):
        return repr(found), found.octets, found.frame, [repr(one) for one in found.malformed]
    if isinstance(found, dissect.ScdMessage):
        return found.subject, found.message.values, [repr(row) for row in found.values]
    if isinstance(found, dissect.Finding):
        return repr(found), found.rule.slug, found.detail, found.frames
    if isinstance(found, dissect.Act):
        return repr(found), str(found), found.frames, said(found.connection), found.operation and said(found.operation)
    if isinstance(found, dissect.Operation):
        return repr(found), found.content, found.result, found.transactions
    if isinstance(found, dissect.CarvedBlock):
        return repr(found), found.octets, found.parts(), found.plc, found.missing
    if isinstance(found, dissect.Pipeline):
        return found.frames, found.finding_counts, [one.describe() for one in found.protocols]
    if isinstance(found, dissect.ValueRow):
        return repr(found), found.value, found.host, found.plc.host, found.unit, found.connection
    if isinstance(found, dissect.Options):
        return found.slow_ns, found.memory
    if isinstance(found, dissect.Where):
        return found.text, [found.transaction(one) for one in of(dissect.Transaction)]
    if isinstance(found, dissect.Observer):
        return found.wants_facts, found.wants_pdus, found.wants_tpdus, found.own_book
    return repr(found)


def _pickled(number: int) -> Callable[[Any], Any]:
    return lambda one: pickle.loads(pickle.dumps(one, number))


WAYS: Final[dict[str, Callable[[Any], Any]]] = {
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
    **{f"pickle {number}": _pickled(number) for number in range(2, 6)},
}


@pytest.mark.parametrize("name", sorted(MADE))
def test_objects_copy_and_pickle(name: str) -> None:
    objects = MADE[name]()
    assert objects
    for found in objects[:40]:
        expected = said(found)
        for way, take in WAYS.items():
            taken = take(found)
            assert type(taken) is type(found)
            assert taken is not found or isinstance(found, tuple)
            assert said(taken) == expected, way
            assert said(found) == expected, way


@pytest.mark.parametrize("name", sorted(MADE))
def test_objects_are_equal_as_is_promised(name: str) -> None:
    """An object equals itself only (docs/api.md), an item, which is a tuple, any with the same content."""
    for one in MADE[name]()[:20]:
        other = copy.copy(one)
        assert one == one  # noqa: PLR0124
        assert (one == other) is isinstance(one, tuple)
        assert one != str(one)
        assert isinstance(one, tuple) or isinstance(hash(one), int)


@pytest.mark.parametrize("name", sorted(MADE))
def test_public_classes_have_help(name: str) -> None:
    text = pydoc.plain(pydoc.render_doc(getattr(dissect, name)))
    assert f"class {name}" in text
    assert " object at 0x" not in "".join([repr(one) for one in MADE[name]()[:3]]) or name in {"Observer", "Pipeline"}


def declared(name: str) -> set[str]:
    """Return the public attributes of a class as its source has them."""
    home = kind_of(name).__module__
    source = Path(dissect.__file__).parent.joinpath(*home.split(".")[1:]).with_suffix(".py").read_text("utf-8")
    (node,) = [one for one in ast.parse(source).body if isinstance(one, ast.ClassDef) and one.name == name]
    found = set()
    for one in node.body:
        if isinstance(one, ast.AnnAssign) and isinstance(one.target, ast.Name):
            found.add(one.target.id)
        if isinstance(one, ast.FunctionDef) and one.name == "__init__":
            found |= {
                target.attr
                for inner in ast.walk(one)
                if isinstance(inner, (ast.Assign, ast.AnnAssign))
                for target in (inner.targets if isinstance(inner, ast.Assign) else [inner.target])
                if isinstance(target, ast.Attribute) and ast.unparse(target.value) == "self"
            }
    methods = {one.name for one in node.body if isinstance(one, ast.FunctionDef)}
    return {one for one in found - methods if not one.startswith("_")}


def kind_of(name: str) -> type:
    found = getattr(dissect, name)
    assert isinstance(found, type)
    return found


@pytest.mark.parametrize("name", sorted(name for name in dissect._PUBLIC if name[0].isupper()))
def test_every_member_says_what_it_is(name: str) -> None:
    """Methods and properties in their docstring, attributes in the text of their class; compiled, also in their own."""
    kind, table = kind_of(name), ATTRIBUTES.get(name, {})
    shown = pydoc.plain(pydoc.render_doc(kind))
    inherited = {one for above in kind.__mro__[1:] for one in ATTRIBUTES.get(above.__name__, {})}
    missing = declared(name) - {one for one, said in table.items() if f"{one}: {said}" in " ".join(shown.split("\n"))}
    assert missing - inherited == set()
    assert not {one for one in table if one not in declared(name) | inherited and not hasattr(kind, one)}
    members = {one: value for one, value in vars(kind).items() if not one.startswith("_")}
    compiled = is_compiled(kind)
    silent = [one for one, value in members.items() if not value.__doc__ and (compiled or one not in table)]
    assert silent == []


def is_compiled(kind: type) -> bool:
    """Tell whether a class is one of mypyc's."""
    return not str(getattr(sys.modules[kind.__module__], "__file__", "")).endswith(".py")


def test_what_is_shared_stays_shared() -> None:
    transactions = of(dissect.Transaction)
    again = pickle.loads(pickle.dumps(transactions))
    assert len({id(one.connection) for one in again}) == len({id(one.connection) for one in transactions})
    assert copy.copy(transactions[0]).connection is transactions[0].connection
    finding = copy.deepcopy(of(dissect.Finding)[0])
    assert finding.rule is of(dissect.Finding)[0].rule


#: What these hold is the machinery of a run, or a part of it: they go as a whole.
WHOLE: Final = frozenset(("Analysis.ledger", "Analysis.own_ledger", "Analysis.pipeline", "Pipeline", "Where.context"))
#: Bookkeeping of the engine, which needs no words of its own.
SILENT: Final = frozenset(
    (
        "Book",
        "Counted",
        "Direction",
        "HalfStream",
        "ItemReader",
        "OpenOperations",
        "OpenRequests",
        "Program",
        "Traits",
        "Writes",
    )
)


def held(path: str, found: Any, depth: int) -> Iterator[tuple[str, Any]]:
    """Give what an object of ours holds in its public attributes, lists and dictionaries, and what that holds."""
    if isinstance(found, (list, tuple, set)) and type(found).__module__ == "builtins":
        for one in list(found)[:3]:
            yield from held(f"{path}[]", one, depth)
    elif isinstance(found, dict):
        for one in [*list(found)[:3], *list(found.values())[:3]]:
            yield from held(f"{path}[]", one, depth)
    elif type(found).__module__.startswith("dissect.") and path not in WHOLE:
        yield path, found
        for name in [name for name in dir(found) if depth and not name.startswith("_") and name not in OLD]:
            value = getattr(found, name)
            if not inspect.isroutine(value):
                yield from held(f"{path}.{name}", value, depth - 1)


@pytest.mark.parametrize("name", sorted(MADE))
def test_what_a_public_object_holds_leaves_as_well_and_has_words(name: str) -> None:
    seen: Counter[type] = Counter()
    for one in MADE[name]()[:12]:
        for path, found in held(name, one, 2):
            seen[type(found)] += 1
            assert type(found).__doc__, path
            if seen[type(found)] > 4:
                continue
            for way in ("copy", "deepcopy", "pickle 5"):
                taken = WAYS[way](found)
                assert type(taken) is type(found), path
                assert repr(taken) == repr(found) or " object at 0x" in repr(found), path
            words = " object at 0x" not in repr(found)
            assert words or type(found).__name__ in SILENT | {"Observer"}, path
    assert name == "Pipeline" or seen


def test_parts_of_a_message_keep_their_layouts() -> None:
    for pdu in of(dissect.Pdu)[:12]:
        body = pdu.body
        for take in WAYS.values():
            again = take(body)
            assert [part.layout for part in again.parts] == [part.layout for part in body.parts]
            for part, other in zip(body.parts, again.parts, strict=True):
                assert [repr(value) for value in other.values] == [repr(value) for value in part.values]
                assert all(take(value.field) is value.field for value in other.values)
    own = Layout("own", "nowhere", [])
    with pytest.raises(TypeError, match="a Layout of your own cannot be copied or pickled: it stands in no constant"):
        pickle.dumps(own)


def test_frames_leave_with_their_tables() -> None:
    frames = dissect.frames(CAPTURES / FILES[0], library="arrow", tables=["items", "pdus"])
    items = frames["items"]
    for take in WAYS.values():
        taken = take(frames)
        assert repr(taken) == repr(frames)
        assert taken["items"].equals(items)
        assert len(taken.pdus) == len(frames.pdus)


def test_a_stream_and_an_interface_say_why_they_stay(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(iterating, "open_live", lambda *_: Line())
    with dissect.live("eth0") as live, dissect.stream() as stream:
        for found, reason in (
            (live, "a Live cannot be copied or pickled: it reads an interface"),
            (stream, "a Stream cannot be copied or pickled: it follows a connection; copy the events"),
        ):
            for take in WAYS.values():
                with pytest.raises(TypeError, match=reason):
                    take(found)


def test_a_run_says_why_it_stays() -> None:
    run = dissect.Run([CAPTURES / FILES[0]], dissect.Observer())
    for take in WAYS.values():
        with pytest.raises(TypeError, match="a Run cannot be copied or pickled: it reads a file"):
            take(run)


class Mine(dissect.Observer):
    """An observer of a user, whose constructor needs an argument."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self.name = name
        self.seen: list[int] = []

    def transaction(self, transaction: dissect.Transaction) -> None:
        self.seen.append(int(transaction.number))


def test_observers_of_users_are_taken_along() -> None:
    mine = Mine("one")
    dissect.Run([CAPTURES / FILES[0]], mine).read()
    for take in WAYS.values():
        taken = take(mine)
        assert (taken.name, taken.seen, taken.wants_pdus) == ("one", mine.seen, False)
    assert copy.deepcopy(mine).seen is not mine.seen


def transactions_of(path: str) -> list[dissect.Transaction]:
    return [event for event in dissect.open(path, pdus=False) if isinstance(event, dissect.Transaction)]


def test_a_pool_of_spawned_processes_returns_everything() -> None:
    paths = [str(CAPTURES / name) for name in FILES]
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as pool:
        analyses = list(pool.map(dissect.analyze, paths))
        lists = list(pool.map(transactions_of, paths))
        there = pool.submit(said, of(dissect.Transaction)[0]).result()
    for path, analysis, transactions in zip(paths, analyses, lists, strict=True):
        assert json.dumps(analysis.as_dict()) == json.dumps(dissect.analyze(path).as_dict())
        assert [said(one) for one in transactions] == [said(one) for one in transactions_of(path)]
    assert there == said(of(dissect.Transaction)[0])


#: Loads what another process pickled, and sends it back with what it says there.
THERE: Final = """
import pickle, sys
from pathlib import Path
import dissect
from tests.test_leaving import said
found = pickle.loads(Path(sys.argv[1]).read_bytes())
told = [said(one) for one in found]
Path(sys.argv[2]).write_bytes(pickle.dumps((found, told, dissect.__file__)))
"""


@pytest.mark.parametrize("name", sorted(MADE))
def test_pickles_pass_between_this_build_and_the_tree(name: str, tmp_path: Path) -> None:
    """The tree is interpreted, what is tested may be compiled: each reads what the other wrote."""
    root, objects = Path(__file__).parents[1], MADE[name]()[:10]
    sent, returned = tmp_path / "sent", tmp_path / "returned"
    sent.write_bytes(pickle.dumps(objects))
    done = subprocess.run(
        [sys.executable, "-c", THERE, str(sent), str(returned)],
        cwd=root,
        env={**os.environ, "PYTHONPATH": str(root)},
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    again, told, where = pickle.loads(returned.read_bytes())
    assert Path(where).is_relative_to(root)
    assert told == [said(one) for one in objects]
    assert [said(one) for one in again] == told
