"""Many small cases in one test: like `pytest.mark.parametrize`, without the cost of a test for each."""

from __future__ import annotations

import functools
import inspect
import os
from collections.abc import Callable, Iterable
from typing import Any, Final

#: Before a release (`make release-tests`) tests of variable size use the large one, which takes too long for every change.
RELEASE: Final = os.environ.get("S7DISSECT_EFFORT") == "release"

Test = Callable[..., None]


def each(names: str | tuple[str, ...], values: Iterable[Any]) -> Callable[[Test], Test]:
    """Run the test with each of ``values`` as its argument ``names``, even after failures, which name their value.

    With several names each of the values is a tuple of as many.
    """
    several = (names,) if isinstance(names, str) else names
    cases = [dict(zip(several, (value,) if isinstance(names, str) else value, strict=True)) for value in values]
    assert cases, "a test of no case"

    def decorate(test: Test) -> Test:
        @functools.wraps(test)
        def run(**fixtures: Any) -> None:
            failures: list[Exception] = []
            for case in cases:
                try:
                    test(**fixtures, **case)
                except Exception as error:  # noqa: BLE001 - whatever a test fails with
                    error.add_note("the case: " + ", ".join(f"{name}={value!r}" for name, value in case.items()))
                    failures.append(error)
            if len(failures) == 1:
                raise failures[0]
            if failures:
                raise ExceptionGroup(f"{len(failures)} of {len(cases)} cases failed", failures[:20])

        wanted = inspect.signature(test)
        fixtures = [parameter for parameter in wanted.parameters.values() if parameter.name not in several]
        run.__signature__ = wanted.replace(parameters=fixtures)  # type: ignore[attr-defined]
        return run

    return decorate
