from __future__ import annotations

import types

from dissect.wire import build
from dissect.wire.codes import CodeTable


def test_compiled_tells_the_truth() -> None:
    interpreted = isinstance(CodeTable.name, types.FunctionType)
    assert interpreted is not build.COMPILED
