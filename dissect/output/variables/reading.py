"""Values in Python: `values` iterates rows; `value_tables` makes an Arrow table of them for each variable."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from datetime import timedelta
from typing import TYPE_CHECKING, Any, Final

from dissect.engine.pipeline import Options
from dissect.files.session import KeyLogFiles, Run, Tags, decoder_of, reading_of
from dissect.output.variables.collector import ValueCollector
from dissect.output.variables.model import ValueRow, Variable
from dissect.packets.source.given import Source
from dissect.packets.tcp.link import within

if TYPE_CHECKING:
    import pyarrow

    from dissect.meaning.select import Where
    from dissect.scd.dictionary import Dictionary

_NEEDS: Final = "value_tables needs pyarrow: pip install 's7dissect[data]'"
#: One more than the largest number of an int64, of which the smallest is as far below 0; and of a uint64.
_BEYOND_SIGNED: Final = 2**63
_BEYOND_UNSIGNED: Final = 2**64


def values(
    path: Source,
    *more: Source,
    of: str | Sequence[str] = (),
    changes: bool = False,
    every: timedelta | None = None,
    likely: bool = False,
    refusals: bool = False,
    where: str | Where | None = None,
    tags: Tags = None,
    scd: str | os.PathLike[str] | Dictionary | None = None,
    bind: str | os.PathLike[str] | None = None,
    checksums: bool = False,
    tls_keys: KeyLogFiles = None,
) -> Iterator[ValueRow]:
    """Iterate the values of variables that were read, written or pushed in one capture or several.

    ``of`` are addresses ("DB10.DBD4:REAL") and names of tags; without it the values of all items are returned. ``changes``
    leaves out values equal to the one before, ``every`` all but the first value of a variable in each interval of this length.
    ``likely`` adds the values of pairs of request and answer that are only likely; `ValueRow.doubt` of these says why.
    ``refusals`` adds a row without value for each item that the PLC refused; its `ValueRow.refused` says why. The others are as
    for `dissect.open`; ``where`` selects transactions. Rows come in the order in which their transactions were complete; at
    most 20,000 variables have a value before (`dissect.output.variables.tracker.MAX_VARIABLES`). Raises
    `dissect.output.variables.choosing.WantedError` for a name that is neither an address nor a tag, ValueError for a time that
    is not above 0, and what `dissect.open` raises.
    """
    every_ns = 0
    if every is not None:
        every_ns = round(every / timedelta(microseconds=1)) * 1000
        if every_ns <= 0:
            raise ValueError(f"every: expected a time above 0, got {every}")
    decoder = decoder_of(scd, bind)
    options = Options(decoder=decoder, checksums=checksums)
    reading = reading_of([path, *more], options, where, tags, tls_keys)
    wanted = None
    names = [of] if isinstance(of, str) else list(of)
    if names:
        from dissect.output.variables.choosing import Known, choose, scd_names

        wanted = choose(names, Known(options.naming, scd_names(decoder), of_command=False))
    wants = reading.where.predicate("transaction") if reading.where is not None else None
    collector = ValueCollector(wanted, changes, every_ns, False, wants, likely=likely, refusals=refusals)
    return _rows(reading.run(collector, sieved=False), collector)


def _rows(run: Run, collector: ValueCollector) -> Iterator[ValueRow]:
    try:
        while run.step():
            yield from collector.take()
        yield from collector.take()
    finally:
        run.close()


def value_tables(rows: Iterable[ValueRow]) -> dict[str, pyarrow.Table]:
    """Return rows of values as Arrow tables, one for each variable, by its name, or else its address.

    If several variables have one name, the type follows it, and the PLC if that is not sufficient. Columns: ``time``
    (nanoseconds, UTC), ``value`` (of the type of the values: bool, int64, double, string, or lists of these; as text if the
    types differ), ``how``, ``client``, ``connection``, ``frame``, ``certainty``; rows are in order of time. The facts of the
    variable are in the metadata of the schema: ``plc``, ``address``, ``tag``, ``type``, ``unit``. All values are in memory.
    Raises ImportError with an instruction to install pyarrow if it is missing.
    """
    try:
        import pyarrow as pa
    except ImportError:
        raise ImportError(_NEEDS) from None
    found: dict[Variable, list[ValueRow]] = {}
    for row in rows:
        found.setdefault(row.variable, []).append(row)
    names = _names(list(found))
    return {names[variable]: _table(pa, variable, of_it) for variable, of_it in found.items()}


def _names(variables: list[Variable]) -> dict[Variable, str]:
    """Return a unique name for each variable."""
    forms = (
        lambda one: one.name,
        lambda one: f"{one.name} {one.type}".rstrip(),
        lambda one: f"{one.name} {one.type} {within(str(one.plc), one.vlan)}",
    )
    names: dict[Variable, str] = {}
    left = variables
    for form in forms:
        by_name: dict[str, list[Variable]] = {}
        for variable in left:
            by_name.setdefault(form(variable), []).append(variable)
        names.update({them[0]: name for name, them in by_name.items() if len(them) == 1 and name not in names.values()})
        left = [variable for variable in left if variable not in names]
    names.update({variable: f"{forms[2](variable)} {number}" for number, variable in enumerate(left, 1)})
    return names


def _table(pa: Any, variable: Variable, rows: list[ValueRow]) -> pyarrow.Table:
    rows = sorted(rows, key=lambda row: int(row.time_ns))
    found = [row.value for row in rows]
    kind = _kind(pa, found)
    if kind is None:
        found = [None if value is None else str(value) for value in found]
        kind = pa.string()
    elif kind.equals(pa.float64()) or kind.equals(pa.list_(pa.float64())):
        found = [_floats(value) for value in found]
    about = {
        "plc": str(variable.plc),
        "address": variable.address,
        "tag": variable.tag,
        "type": variable.type,
        "unit": variable.unit,
    }
    columns = {
        "time": pa.array([int(row.time_ns) for row in rows], pa.timestamp("ns", "UTC")),
        "value": pa.array(found, kind),
        "how": pa.array([row.how for row in rows]),
        "client": pa.array([row.host for row in rows]),
        "connection": pa.array([row.connection for row in rows], pa.int64()),
        "frame": pa.array([int(row.frame) for row in rows], pa.int64()),
        "certainty": pa.array([row.certainty for row in rows]),
    }
    table: pyarrow.Table = pa.table(
        columns, metadata={key: text.encode("utf-8", "replace") for key, text in about.items()}
    )
    return table


def _kind(pa: Any, found: Sequence[object]) -> Any:
    """Return the Arrow type of values, None if they have no type in common."""
    there = [value for value in found if value is not None]
    if there and all([isinstance(value, list) for value in there]):
        inner = _kind(pa, [element for value in there for element in value])  # type: ignore[attr-defined]  # they are lists
        return pa.list_(inner) if inner is not None else None
    if all([isinstance(value, bool) for value in there]):
        return pa.bool_() if there else pa.string()
    if any([isinstance(value, bool) for value in there]):
        return None
    if all([isinstance(value, int) for value in there]):
        return _whole(pa, there)  # type: ignore[arg-type]
    if all([isinstance(value, (int, float)) for value in there]):
        return pa.float64()
    return pa.string() if all([isinstance(value, str) for value in there]) else None


def _whole(pa: Any, there: Sequence[int]) -> Any:
    """Return the Arrow type of whole numbers, None if none holds all of them."""
    least, most = min(there), max(there)
    if least >= -_BEYOND_SIGNED and most < _BEYOND_SIGNED:
        return pa.int64()
    return pa.uint64() if least >= 0 and most < _BEYOND_UNSIGNED else None


def _floats(value: Any) -> Any:
    """Return a number, or a list of them, as doubles: Arrow refuses a whole number that a double does not hold exactly."""
    if value is None:
        return None
    return [_floats(element) for element in value] if isinstance(value, list) else float(value)
