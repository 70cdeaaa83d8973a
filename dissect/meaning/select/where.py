"""`Where`: an expression as predicates, one for each kind of thing, made when the first such thing comes.

A comparison is true if any value of the field matches; `!=` is true if there are values and none is equal. If a thing does not
have the field, every comparison with it is false. `not X` holds exactly where X does not.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, Final

from dissect.engine.findings.reporter import Finding
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.operation import Operation
from dissect.engine.transactions.transaction import Transaction
from dissect.meaning.select.errors import SelectError
from dissect.meaning.select.fields import FIELDS, NAMES, WIRESHARK, Field
from dissect.meaning.select.getters import Getter
from dissect.meaning.select.grammar import All, Comparison, Either, FieldName, Literal, Negation, Node, Presence, parse
from dissect.meaning.select.items import ItemFacts
from dissect.meaning.select.literals import IN, S7Address, Test, place_of
from dissect.meaning.select.things import (
    CONNECTION,
    FINDING,
    KINDS,
    MESSAGE,
    OPERATION,
    PACKET,
    TRANSACTION,
    Context,
    Found,
    Message,
    Packet,
)
from dissect.wire.config.hints import close_names

Predicate = Callable[[Any], bool]
#: Judges a connection or a file as a whole: True if a condition is true for everything in it, False if for nothing in it, None
#: if unknown.
Judge = Callable[[Any], bool | None]

#: A text that is in quotes as a whole.
_QUOTED: Final = re.compile(r"""(["'])((?:(?!\1).)*)\1""", re.DOTALL)
#: The plurals of kinds.
PLURALS: Final = {
    TRANSACTION: "transactions",
    OPERATION: "operations",
    FINDING: "findings",
    CONNECTION: "connections",
    MESSAGE: "messages",
    PACKET: "packets",
}


class Where:
    """A selection. ``text`` is the expression as it was typed; the expressions in ``also`` must be true as well.

    ``kinds`` are the kinds of things that will be judged: a field that none of them has is an error. Raises `SelectError`.
    """

    def __init__(
        self, text: str, also: Sequence[str] = (), kinds: Iterable[str] = KINDS, context: Context | None = None
    ) -> None:
        self.context = context if context is not None else Context()
        self.texts = tuple([part for part in (text, *also) if part])
        self._kinds = tuple(kinds)
        self._nodes = [self._checked(part) for part in self.texts or (text,)]
        self._names = {field.name for node in self._nodes for field in _fields(node)}
        #: The addresses and tags in brackets, as they were typed, each once.
        self.variables: tuple[str, ...] = tuple(
            dict.fromkeys([name for node in self._nodes for name in _variables(node)])
        )
        self._made: dict[str, Predicate] = {}
        self._judges: list[Judge] | None = None

    def __repr__(self) -> str:
        return f"Where({self.text!r})"

    def __reduce__(self) -> tuple[Any, ...]:
        return Where, ("", self.texts, self._kinds)  # its predicates are made again

    @property
    def names(self) -> frozenset[str]:
        """The names of the fields in the expression."""
        return frozenset(self._names)

    @property
    def text(self) -> str:
        """The whole expression."""
        return self.texts[0] if len(self.texts) == 1 else " and ".join([f"({part})" for part in self.texts])

    # ---- what it selects --------------------------------------------------------------------------------------------

    def transaction(self, transaction: Transaction) -> bool:
        """Return whether a transaction is selected."""
        return self.predicate(TRANSACTION)(transaction)

    def operation(self, operation: Operation) -> bool:
        """Return whether an operation is selected."""
        return self.predicate(OPERATION)(operation)

    def connection(self, connection: Connection) -> bool:
        """Return whether a connection is selected."""
        return self.predicate(CONNECTION)(connection)

    def finding(self, finding: Finding) -> bool:
        """Return whether a finding is selected; the context must know its connection (`Context.opened`)."""
        return self.predicate(FINDING)(Found(finding, self.context.connection(int(finding.connection))))

    def message(self, message: Message) -> bool:
        """Return whether a message is selected."""
        return self.predicate(MESSAGE)(message)

    def packet(self, packet: Packet) -> bool:
        """Return whether a packet is selected."""
        return self.predicate(PACKET)(packet)

    def predicate(self, kind: str) -> Predicate:
        """Return the predicate for a kind of thing; it is made at the first call."""
        made = self._made.get(kind)
        if made is None:
            made = self._made[kind] = _together([_Maker(kind, self.context).predicate(node) for node in self._nodes])
        return made

    def knows(self, kind: str) -> bool:
        """Return whether things of a kind have every field of the expression, so that their own fields can select them."""
        return all([kind in FIELDS[name].getters for name in self._names])

    @property
    def narrows(self) -> bool:
        """Whether the ends or the number of a connection may be sufficient to rule out everything on it."""
        return any([FIELDS[name].decided or name in _ENDS for name in self._names])

    def may_hold(self, connection: Connection) -> bool:
        """Return whether anything on a connection may be selected, judged by its ends and number; True when in doubt."""
        if self._judges is None:
            self._judges = self.judges(lambda condition: _of_ends(condition, self.context))
        return all([judge(connection) is not False for judge in self._judges])

    def judges(self, of_condition: Callable[[Presence | Comparison], Judge]) -> list[Judge]:
        """Return a judge for each expression; ``of_condition`` returns the judge for a single condition."""
        return [_judge(node, of_condition) for node in self._nodes]

    # ---- making -----------------------------------------------------------------------------------------------------

    def _checked(self, text: str) -> Node:
        """Return the tree of an expression. Raises `SelectError` for unknown fields and values of the wrong type."""
        node = parse(text)
        for condition in _conditions(node):
            name = condition.field
            field = self._field(name, text)
            try:
                _index(name, field, self.context)
                if isinstance(condition, Comparison):
                    comparison_test(condition, field, self.context)
            except SelectError as error:
                raise error.within(text, error.start, error.end) from None
        return node

    def _field(self, name: FieldName, text: str) -> Field:
        field = NAMES.get(name.name)
        if field is None:
            known = WIRESHARK.get(name.name)
            near = [known] if known else close_names(name.name, NAMES)
            hint = f"; did you mean {' or '.join(near)}?" if near else "; `s7dissect fields` lists the fields"
            raise SelectError(f"no field {name.name!r}{hint}", text, name.start, name.end)
        if not any([kind in field.getters for kind in self._kinds]):
            here = " and ".join([PLURALS[kind] for kind in self._kinds])
            there = " and ".join([PLURALS[kind] for kind in field.things])
            raise SelectError(f"{here} have no field {name.name!r}; {there} have it", text, name.start, name.end)
        return field


def _fields(node: Node) -> Iterator[Field]:
    for condition in _conditions(node):
        yield NAMES[condition.field.name]


def _variables(node: Node) -> Iterator[str]:
    for condition in _conditions(node):
        if condition.field.index:
            yield _unquoted(condition.field.index)


def _conditions(node: Node) -> Iterator[Presence | Comparison]:
    if isinstance(node, Negation):
        yield from _conditions(node.within)
    elif isinstance(node, (All, Either)):
        for part in node.parts:
            yield from _conditions(part)
    else:
        yield node


def _together(predicates: list[Predicate]) -> Predicate:
    if len(predicates) == 1:
        return predicates[0]
    return lambda thing: all([predicate(thing) for predicate in predicates])


#: Operators that are true if their counterpart is true for no value.
_NEGATED: Final = {"!=": "==", "!==": "=="}


def comparison_test(condition: Comparison, field: Field, context: Context) -> Test:
    """Return the test of one value; for `!=` and `!==` the test of `==`.

    Raises `SelectError` if the field does not take the operator or the literals.
    """
    operator = condition.operator
    kind = field.kind.zoned(context.local)
    if operator not in kind.operators:
        takes = ", ".join(field.kind.operators)
        raise SelectError(
            f"{field.name} ({field.kind.name}) cannot be compared with {operator}; it takes {takes}",
            start=condition.start, end=condition.end,
        )  # fmt: skip
    plain = "==" if operator == "===" else _NEGATED.get(operator, operator)
    return kind.test(plain, condition.literals, lambda: context.start())  # noqa: PLW0108 - it may be set later


def _index(name: FieldName, field: Field, context: Context) -> Callable[[ItemFacts], ItemFacts | None] | None:
    """Return a function that picks the thing named in brackets: the item with this address, or this tag in it.

    None for a field without brackets. Raises `SelectError` for brackets after a field that items do not have.
    """
    if not name.index:
        return None
    if field.of_item is None:
        raise SelectError(
            f"{field.name} is not of an item, so that no brackets can follow", start=name.start, end=name.end
        )
    literal = Literal(_unquoted(name.index), True, name.start, name.end)
    same = S7Address().compare("==", literal, context.start)
    block = place_of(literal.text)
    if block is not None and block.whole:
        same = block.overlaps

    def picked(item: ItemFacts) -> ItemFacts | None:
        if item.place is not None and same(item.place):
            return item
        return item.of_tag(literal.text)

    return picked


def _unquoted(index: str) -> str:
    """Return the text in brackets without the quotes around it; a name may end with quotes of its own: DB1."level"."""
    quoted = _QUOTED.fullmatch(index)
    return quoted[2] if quoted else index


class _Maker:
    """Makes predicates for one kind of thing."""

    def __init__(self, kind: str, context: Context) -> None:
        self._kind = kind
        self._context = context

    def predicate(self, node: Node) -> Predicate:
        """Return the predicate of a tree."""
        if isinstance(node, Negation):
            inner = self.predicate(node.within)
            return lambda thing: not inner(thing)
        if isinstance(node, (All, Either)):
            parts = [self.predicate(part) for part in node.parts]
            return _every(parts) if isinstance(node, All) else _some(parts)
        field = NAMES[node.field.name]
        get = self._getter(node.field, field)
        if get is None:
            return _never
        if isinstance(node, Presence):
            return self._present(field, get)
        return self._compared(node, comparison_test(node, field, self._context), get)

    def _getter(self, name: FieldName, field: Field) -> Getter | None:
        get = field.getters.get(self._kind)
        index = _index(name, field, self._context)
        if get is None or index is None:
            return get
        of_item = field.of_item
        from dissect.meaning.select.getters import items

        def indexed(thing: Any, context: Context) -> list[Any]:
            found: list[Any] = []
            for item in items(thing, context):
                named = index(item)
                if named is not None:
                    value = of_item(named, context) if of_item is not None else None
                    if isinstance(value, list):
                        found += value
                    elif value is not None:
                        found.append(value)
            return found

        return indexed

    def _present(self, field: Field, get: Getter) -> Predicate:
        context = self._context
        if field.kind.truth:
            return lambda thing: bool(get(thing, context))
        return lambda thing: get(thing, context) not in (None, [], ())

    def _compared(self, condition: Comparison, test: Test, get: Getter) -> Predicate:
        context = self._context
        operator = condition.operator

        def holds(thing: Any) -> bool:
            found = get(thing, context)
            if found is None:
                return False
            if type(found) is not list and type(found) is not tuple:
                return test(found)
            for value in found:  # noqa: SIM110 - a generator costs as much as a condition
                if test(value):
                    return True
            return False

        def none_equal(thing: Any) -> bool:
            found = _listed(get(thing, context))
            return bool(found) and not any([test(value) for value in found])

        def one_differs(thing: Any) -> bool:
            return not all([test(value) for value in _listed(get(thing, context))])

        def all_equal(thing: Any) -> bool:
            found = _listed(get(thing, context))
            return bool(found) and all([test(value) for value in found])

        return {"!=": none_equal, "!==": one_differs, "===": all_equal}.get(operator, holds)


def _listed(found: Any) -> Sequence[Any]:
    if found is None:
        return ()
    return found if type(found) is list or type(found) is tuple else (found,)


def _never(_thing: Any) -> bool:
    return False


def _every(parts: list[Predicate]) -> Predicate:
    if len(parts) == 2:
        first, second = parts
        return lambda thing: first(thing) and second(thing)

    def every(thing: Any) -> bool:
        for part in parts:  # noqa: SIM110 - as above
            if not part(thing):
                return False
        return True

    return every


def _some(parts: list[Predicate]) -> Predicate:
    if len(parts) == 2:
        first, second = parts
        return lambda thing: first(thing) or second(thing)

    def some(thing: Any) -> bool:
        for part in parts:  # noqa: SIM110 - as above
            if part(thing):
                return True
        return False

    return some


# ---- what a connection alone decides --------------------------------------------------------------------------------

#: Fields that name one end. A comparison with an address of neither end of the connection is false.
_ENDS: Final = frozenset(("client", "server", "asked_by", "answered_by"))


def _of_ends(condition: Presence | Comparison, context: Context) -> Judge:
    """Return the judge of connections for one condition, by their ends and number."""
    if isinstance(condition, Comparison):
        field = NAMES[condition.field.name]
        if field.decided:
            return predicate_of(CONNECTION, condition, context)
        if field.name in _ENDS and condition.operator in {"==", "===", IN}:
            test = comparison_test(condition, field, context)
            return lambda connection: None if any([test(end) for end in connection.tcp.ends]) else False
    return lambda _connection: None


def predicate_of(kind: str, condition: Presence | Comparison, context: Context) -> Predicate:
    """Return the predicate of one condition for a kind of thing."""
    return _Maker(kind, context).predicate(condition)


def _judge(node: Node, of_condition: Callable[[Presence | Comparison], Judge]) -> Judge:
    """Return the judge of a whole expression, made from the judges of its conditions."""
    if isinstance(node, Negation):
        inner = _judge(node.within, of_condition)

        def turned(thing: Any) -> bool | None:
            found = inner(thing)
            return None if found is None else not found

        return turned
    if isinstance(node, (All, Either)):
        return _joined([_judge(part, of_condition) for part in node.parts], isinstance(node, Either))
    return of_condition(node)


def _joined(parts: list[Judge], either: bool) -> Judge:
    """Return the judge of several conditions: one of them must be true (``either``), or all of them."""

    def joined(thing: Any) -> bool | None:
        found = [part(thing) for part in parts]
        if either in found:
            return either
        return None if None in found else not either

    return joined
