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


def test_the_rows_of_statistics_begin_where_those_of_s7comm_end() -> None:
    assert [is_plus_key(key) for key in (0, 0x10000, 0x1FFFF, 0x20000, 0x30001)] == [False, False, False, True, True]
    assert [names_function(key) for key in (0x20000, 0x2FFFF, 0x30000, 0x30001)] == [True, True, False, False]
    assert PlusParameters(0).function == 0x20000
    assert PlusParameters(0xFFFF).function == 0x2FFFF
    assert PlusParameters(-1).function == PlusParameters(-1).statistics_key == 0x30000


def test_a_row_is_named_after_its_function_or_shared() -> None:
    for code, name, row in (
        (-1, "S7comm-plus notification", "S7comm-plus notification"),
        (0, "S7comm-plus 0x0000", "S7comm-plus unknown function"),
        (0x04BB, "S7comm-plus Explore", "S7comm-plus Explore"),
        (0x04BC, "S7comm-plus 0x04bc", "S7comm-plus unknown function"),
    ):
        one = PlusParameters(code)
        assert (one.function_name, one.statistics_name) == (name, row)
        assert (one.statistics_key == PlusParameters(0x1234).statistics_key) == row.endswith("unknown function")
        assert one.starts_tls == (code == INIT_SSL)


def test_the_cache_gives_each_code_its_own() -> None:
    cache = PlusParameterCache()
    codes = [-1, 0, *range(0x0400, 0x0800), 0xFFFF]
    first = [cache.get(code) for code in codes]
    assert [one.code for one in first] == codes
    assert all(cache.get(code) is one for code, one in zip(codes, first, strict=True))


def test_the_cache_is_emptied_when_it_is_full() -> None:
    cache = PlusParameterCache()
    first = cache.get(0x8000)
    for code in range(0x8001, 0x8000 + cache.CAPACITY):
        cache.get(code)
    assert cache.get(0x8000) is first
    cache.get(0x7FFF)
    assert cache.get(0x8000) is not first
    assert cache.get(0x054C) is cache.get(0x054C)
