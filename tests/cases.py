"""Many small cases in one test: what `pytest.mark.parametrize` says, without the cost of a test for each."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Iterable
from typing import Any

Test = Callable[..., None]


def each(name: str, values: Iterable[object]) -> Callable[[Test], Test]:
    """Run the test with each of ``values`` as its argument ``name``, all of them even when some fail; failures name theirs."""
    cases = tuple(values)
    assert cases, "a test of no case"

    def decorate(test: Test) -> Test:
        @functools.wraps(test)
        def run(**fixtures: Any) -> None:
            failures: list[Exception] = []
            for value in cases:
                try:
                    test(**fixtures, **{name: value})
                except Exception as error:  # noqa: BLE001 - whatever a test fails with
                    error.add_note(f"the case: {name}={value!r}")
                    failures.append(error)
            if len(failures) == 1:
                raise failures[0]
            if failures:
                raise ExceptionGroup(f"{len(failures)} of {len(cases)} cases failed", failures[:20])

        wanted = inspect.signature(test)
        fixtures = [parameter for parameter in wanted.parameters.values() if parameter.name != name]
        run.__signature__ = wanted.replace(parameters=fixtures)  # type: ignore[attr-defined]
        return run

    return decorate
