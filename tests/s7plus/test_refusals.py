"""Whether a response refuses items, asked by several threads at the same time: a program may analyze captures side by side."""

from __future__ import annotations

import sys
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier

from dissect.s7plus import skimming
from dissect.s7plus.refusals import answered, glimpse
from dissect.s7plus.tables import DELETE_OBJECT, GET_MULTI_VARIABLES
from dissect.s7plus.value_tables import INT
from dissect.s7plus.values import Value
from dissect.wire.varint import VLQ64, build_varint
from tests.s7plus.bodies import multi_got
from tests.s7plus.pdus import framed, told

_FIVE = Value(0, INT, 5)
_REFUSED = framed(told(1, GET_MULTI_VARIABLES, multi_got([(1, _FIVE)] * 20, [(21, 2**64 - 12)])))
_GOOD = framed(told(1, GET_MULTI_VARIABLES, multi_got([(1, _FIVE)] * 9, [])))
_DENIED = framed(told(1, DELETE_OBJECT, build_varint(0xFFFF9C, VLQ64)), 3)


def test_threads_do_not_disturb_each_other() -> None:
    together = Barrier(3)

    def ask(octets: bytes) -> set[tuple[int, bool]]:
        together.wait()
        return {answered(octets, glimpse(octets)) for _ in range(5000)}

    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(3) as pool:
            found = list(pool.map(ask, (_REFUSED, _GOOD, _DENIED)))
    finally:
        sys.setswitchinterval(interval)
    assert found == [{(0, True)}, {(0, False)}, {(0xFF9C, True)}]


def test_what_reads_a_pdu_is_used_by_one_at_a_time_and_then_again() -> None:
    one, other = skimming.free_body(), skimming.free_body()
    assert one is not other
    free = len(skimming._FREE)
    for octets in (_REFUSED, _GOOD, _DENIED):
        assert answered(octets, glimpse(octets))[1] is (octets != _GOOD)
    assert len(skimming._FREE) == max(free, 1)
