"""Numbers on the command line: ``10``, ``10-12`` or ``10..12``; and choices by the words that people use."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, Final

import click

if TYPE_CHECKING:
    _RangeType = click.ParamType[range]
    _ChoiceType = click.Choice[str]
else:
    _RangeType = click.ParamType
    _ChoiceType = click.Choice

_RANGE: Final = re.compile(r"([0-9]{1,15})(?:(?:-|\.\.)([0-9]{1,15}))?")


class NumberRange(_RangeType):
    """A number from 1, or a range of them."""

    name = "numbers"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> range:
        """Return the numbers that a text denotes."""
        match = _RANGE.fullmatch(value)
        first = int(match[1]) if match else 0
        last = int(match[2] or first) if match else 0
        if not 1 <= first <= last:
            raise click.BadParameter(f"expected a number from 1, or a range such as 10-12, got {value!r}.", ctx, param)
        return range(first, last + 1)


class Numbers:
    """The choice of several `NumberRange` options."""

    def __init__(self, ranges: Iterable[range]) -> None:
        self.ranges = list(dict.fromkeys(ranges))

    def __contains__(self, number: object) -> bool:
        return any([number in one for one in self.ranges])


class DescribedChoice(_ChoiceType):
    """A choice whose values have sentences; a word of such a sentence leads to its value."""

    def __init__(self, described: Mapping[str, str]) -> None:
        super().__init__(list(described))
        self._described = described

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the value; for an unknown word, list the values it could mean."""
        if value in self._described:
            return str(value)
        stem = str(value).lower().rstrip("s")
        meant = [name for name, sentence in self._described.items() if len(stem) > 2 and stem in sentence.lower()][:3]
        if not meant:
            return super().convert(value, param, ctx)
        option = param.opts[0] if param is not None else ""
        choices = "; ".join([f"{option} {name}: {self._described[name]}" for name in meant])
        raise click.BadParameter(f"there is no {value!r}, but {choices}", ctx, param)
