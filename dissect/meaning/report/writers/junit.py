"""Test results as JUnit XML, which CI systems show."""

from __future__ import annotations

from collections.abc import Iterator
from xml.etree import ElementTree

from dissect.meaning.report.outcome import Case, Tested
from dissect.meaning.report.styled import Line
from dissect.wire.text import printable


def junit_outcome(outcome: Tested) -> Iterator[str | Line]:
    """Yield an outcome as one test suite."""
    name, of, cases = outcome.cases()
    suite = ElementTree.Element(
        "testsuite",
        name=printable(name),
        tests=str(len(cases)),
        failures=str(len([1 for case in cases if case.failures])),
        errors=str(len([1 for case in cases if case.errors])),
        skipped="0",
    )
    for case in cases:
        _add(suite, printable(of), case)
    ElementTree.indent(suite)
    yield '<?xml version="1.0" encoding="utf-8"?>'
    yield ElementTree.tostring(suite, encoding="unicode")


def _add(suite: ElementTree.Element, classname: str, case: Case) -> None:
    element = ElementTree.SubElement(suite, "testcase", classname=classname, name=printable(case.name))
    if case.failures:
        more = f" (and {len(case.failures) - 1} more)" if len(case.failures) > 1 else ""
        kinds = ",".join(sorted({kind for kind, _ in case.failures}))
        message = printable(case.failures[0][1]) + more
        failure = ElementTree.SubElement(element, "failure", type=kinds, message=message)
        if case.listed:
            failure.text = "\n".join([printable(text) for _, text in case.failures])
    for kind, text in case.errors:
        ElementTree.SubElement(element, "error", type=kind, message=printable(text))
