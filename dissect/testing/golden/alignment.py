"""Common subsequence of two sequences: which elements belong together, in a time that grows little more than linearly.

Equal elements at the beginning and the end are paired at once; elements that only one side has are skipped. Elements that are
unique on both sides are anchors (patience diff). Between anchors, and without any (as in polling), Myers' greedy search runs
with a limit on the number of differences. At the limit, the longest path so far is kept and a new search starts at its end.
"""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter
from collections.abc import Sequence
from typing import Final

Pair = tuple[int, int]

#: Maximum number of differences in one search, and maximum depth of anchors between anchors.
_MOST: Final = 128
_DEEP: Final = 16


def align(a: Sequence[int], b: Sequence[int]) -> list[Pair]:
    """Return pairs of positions (in ``a``, in ``b``) with equal elements, ascending in both."""
    pairs: list[Pair] = []
    work: list[tuple[list[int], list[int], int]] = [(list(range(len(a))), list(range(len(b))), 0)]
    while work:
        left, right, depth = work.pop()
        left, right = _trimmed(a, b, left, right, pairs)
        left, right = _shared(a, b, left, right)
        if not left or not right:
            continue
        anchors = _anchors(a, b, left, right) if depth < _DEEP else []
        if not anchors:
            pairs += _searched(a, b, left, right)
            continue
        at, bt = 0, 0
        for i, j in [*anchors, (len(left), len(right))]:
            if i > at and j > bt:
                work.append((left[at:i], right[bt:j], depth + 1))
            at, bt = i + 1, j + 1
        pairs += [(left[i], right[j]) for i, j in anchors]
    pairs.sort()
    return pairs


def _trimmed(
    a: Sequence[int], b: Sequence[int], left: list[int], right: list[int], pairs: list[Pair]
) -> tuple[list[int], list[int]]:
    """Pair equal elements at the beginning and the end, and return the rest."""
    start, most = 0, min(len(left), len(right))
    while start < most and a[left[start]] == b[right[start]]:
        pairs.append((left[start], right[start]))
        start += 1
    end = 0
    while end < most - start and a[left[-1 - end]] == b[right[-1 - end]]:
        pairs.append((left[-1 - end], right[-1 - end]))
        end += 1
    return left[start : len(left) - end], right[start : len(right) - end]


def _shared(a: Sequence[int], b: Sequence[int], left: list[int], right: list[int]) -> tuple[list[int], list[int]]:
    """Return the positions of elements that both sides have."""
    both = {a[i] for i in left} & {b[j] for j in right}
    return [i for i in left if a[i] in both], [j for j in right if b[j] in both]


def _anchors(a: Sequence[int], b: Sequence[int], left: list[int], right: list[int]) -> list[Pair]:
    """Return the longest ascending chain of elements that are unique on both sides, as indices of ``left`` and ``right``."""
    counts, others = Counter(a[i] for i in left), Counter(b[j] for j in right)
    places = {b[j]: at for at, j in enumerate(right) if others[b[j]] == 1}
    pairs = [(at, places[a[i]]) for at, i in enumerate(left) if counts[a[i]] == 1 and a[i] in places]
    ends: list[int] = []  # the smallest position at which a chain of each length ends
    tops: list[int] = []
    before: list[int] = []
    for index, (_, place) in enumerate(pairs):
        length = bisect_left(ends, place)
        before.append(tops[length - 1] if length else -1)
        ends[length : length + 1] = [place]
        tops[length : length + 1] = [index]
    chain: list[Pair] = []
    at = tops[-1] if tops else -1
    while at >= 0:
        chain.append(pairs[at])
        at = before[at]
    chain.reverse()
    return chain


def _searched(a: Sequence[int], b: Sequence[int], left: list[int], right: list[int]) -> list[Pair]:
    """Pair elements by Myers' search, with at most `_MOST` differences per search."""
    first = [a[i] for i in left]
    second = [b[j] for j in right]
    pairs: list[Pair] = []
    x, y = 0, 0
    while x < len(first) and y < len(second):
        shared, x, y = _search(first, second, x, y)
        pairs += [(left[i], right[j]) for i, j in shared]
    return pairs


def _search(a: Sequence[int], b: Sequence[int], x0: int, y0: int) -> tuple[list[Pair], int, int]:
    """Search from (x0, y0); return pairs of positions and where to continue: at the end of one side when all is done."""
    n, m = len(a), len(b)
    reach = {1: x0}
    trace: list[dict[int, int]] = []
    for d in range(_MOST + 1):
        trace.append(dict(reach))
        for k in range(-d, d + 1, 2):
            x = reach[k + 1] if k == -d or (k != d and reach[k - 1] < reach[k + 1]) else reach[k - 1] + 1
            y = y0 + x - x0 - k
            while x < n and y < m and a[x] == b[y]:
                x += 1
                y += 1
            reach[k] = x
            if x >= n and y >= m:
                return _backtracked(trace, x0, y0, d, k, x), n, m
    k = max(range(-_MOST, _MOST + 1, 2), key=lambda k: min(reach[k], n) * 2 - k if y0 + reach[k] - x0 - k <= m else -1)
    x = min(reach[k], n)
    return _backtracked(trace, x0, y0, _MOST, k, reach[k]), x, y0 + x - x0 - k


def _backtracked(trace: list[dict[int, int]], x0: int, y0: int, d: int, k: int, x: int) -> list[Pair]:
    """Return the pairs on the path to ``x`` on diagonal ``k`` with ``d`` differences."""
    pairs: list[Pair] = []
    while d >= 0:
        reach = trace[d]
        down = k == -d or (k != d and reach[k - 1] < reach[k + 1])
        start = reach[k + 1] if down else reach[k - 1] + 1
        pairs += [(at, y0 + at - x0 - k) for at in range(x - 1, start - 1, -1)]
        k = k + 1 if down else k - 1
        x = reach[k]
        d -= 1
    pairs.reverse()
    return pairs
