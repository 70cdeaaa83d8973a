from __future__ import annotations

from dissect.protocols.s7plus.parameters import PlusParameterCache, PlusParameters, is_plus_key, names_function
from dissect.protocols.s7plus.tables import FUNCTIONS, INIT_SSL


def test_a_function() -> None:
    parameters = PlusParameters(0x054C)
    assert (parameters.code, parameters.code_name) == (0x054C, "GetMultiVariables")
    assert parameters.function_name == parameters.statistics_name == "S7comm-plus GetMultiVariables"
    assert names_function(parameters.statistics_key)
    assert parameters.statistics_key & 0xFFFF == 0x054C
    assert not parameters.starts_tls
    assert PlusParameters(INIT_SSL).starts_tls


def test_a_notification() -> None:
    parameters = PlusParameters(-1)
    assert (parameters.code, parameters.code_name) == (-1, "")
    assert parameters.function_name == "S7comm-plus notification"
    assert not names_function(parameters.statistics_key)


def test_unknown_functions_share_their_statistics() -> None:
    keys = {PlusParameters(code).statistics_key for code in range(0x10000) if code not in FUNCTIONS}
    assert len(keys) == 1
    assert not names_function(keys.pop())
    assert PlusParameters(0x1234).function_name == "S7comm-plus 0x1234"
    assert PlusParameters(0x1234).statistics_name == "S7comm-plus unknown function"


def test_no_function_is_one_of_s7comm() -> None:
    """0x0004 is no Read Var, nor a userdata group (0x10000 and more in the statistics)."""
    found = [PlusParameters(code) for code in (0, 4, 5, 0xF0, 0xFFFF, -1)]
    assert all(parameters.function > 0x1FFFF for parameters in found)
    assert all(is_plus_key(parameters.statistics_key) for parameters in found)


def test_the_cache_is_bounded() -> None:
    cache = PlusParameterCache()
    assert cache.get(0x054C) is cache.get(0x054C)
    for code in range(3 * cache.CAPACITY):
        assert cache.get(code).code == code
    assert len(cache._by_code) <= cache.CAPACITY
