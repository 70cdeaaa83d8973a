"""Which connections of two sessions belong together, and which transactions on them."""

from __future__ import annotations

from collections import Counter, defaultdict, deque
from collections.abc import Callable, Collection, Hashable, Sequence
from typing import Final, NamedTuple

from dissect.testing.golden.alignment import align
from dissect.testing.golden.keys import Key, Keys, action
from dissect.testing.golden.model import Link, Session, Transaction

#: Maximum number of pairs of connections whose similarity is computed; beyond it, connections are paired in order.
_WEIGHED: Final = 10_000


#: A gap between transactions that both sessions have in the same order: who spoke first, and the index of the gap.
Region = tuple[str, int]


class Match(NamedTuple):
    """Two matched transactions, or one without a partner (the other is None)."""

    a: Transaction | None
    b: Transaction | None
    moved: bool = False


# ---- connections ----------------------------------------------------------------------------------------------------


def pair_links(a: Session, b: Session, keys: Keys) -> list[tuple[Link | None, Link | None]]:
    """Return the connections that belong together, in the order of the first session; added ones come last.

    Connections with the same TSAPs are paired first, the most similar first. Then the remaining ones are paired if most of
    their requests are the same, or if each session has only one connection.
    """
    counts = {id(link): Counter([keys.exact(each) for each in link.transactions]) for link in (*a.links, *b.links)}
    partners: dict[int, Link] = {}
    left, right = list(a.links), list(b.links)
    groups: dict[Hashable, list[Link]] = defaultdict(list)
    for link in right:
        groups[link.who].append(link)
    for who in dict.fromkeys([link.who for link in left]):
        ours = [link for link in left if link.who == who]
        for one, other in _most_alike(ours, groups[who], counts, 0.0):
            partners[id(one)] = other
    taken = {id(link) for link in partners.values()}
    lonely = [link for link in left if id(link) not in partners]
    others = [link for link in right if id(link) not in taken]
    least = 0.5 if len(left) > 1 or len(right) > 1 else 0.0
    for one, other in _most_alike(lonely, others, counts, least):
        partners[id(one)] = other
    taken = {id(link) for link in partners.values()}
    pairs: list[tuple[Link | None, Link | None]] = [(link, partners.get(id(link))) for link in left]
    return pairs + [(None, link) for link in right if id(link) not in taken]


def _most_alike(
    ours: Sequence[Link], theirs: Sequence[Link], counts: dict[int, Counter[Key]], least: float
) -> list[tuple[Link, Link]]:
    """Pair connections, those with the largest share of common requests first; a pair needs at least the share ``least``."""
    if len(ours) * len(theirs) > _WEIGHED:
        return list(zip(ours, theirs, strict=False)) if least == 0 else []
    weighed = []
    for i, one in enumerate(ours):
        for j, other in enumerate(theirs):
            first, second = counts[id(one)], counts[id(other)]
            total = max(first.total(), second.total())
            share = (first & second).total() / total if total else 1.0
            if share > least or least == 0:
                weighed.append((-share, i, j))
    weighed.sort()
    gone_a: set[int] = set()
    gone_b: set[int] = set()
    pairs = []
    for _, i, j in weighed:
        if i not in gone_a and j not in gone_b:
            gone_a.add(i)
            gone_b.add(j)
            pairs.append((ours[i], theirs[j]))
    return pairs


# ---- transactions ---------------------------------------------------------------------------------------------------


def pair_transactions(a: Sequence[Transaction], b: Sequence[Transaction], keys: Keys) -> list[Match]:
    """Return all transactions of both, paired where they belong together, in order.

    Matched are, in this order: equal requests in the same order; equal requests elsewhere (moved); then, between two of the
    first kind, equal requests with different values, and requests of the same kind, each in order. Each side is ordered by
    itself: unsolicited messages of the server and requests of the client may cross, and their order in the capture means
    nothing.
    """
    numbers: dict[Key, int] = {}
    first = [numbers.setdefault(keys.exact(each), len(numbers)) for each in a]
    second = [numbers.setdefault(keys.exact(each), len(numbers)) for each in b]
    partner: dict[int, int] = {}
    begun_a, begun_b = [_begun_by(each) for each in a], [_begun_by(each) for each in b]
    for who in dict.fromkeys(begun_a):
        left = [at for at, other in enumerate(begun_a) if other == who]
        right = [at for at, other in enumerate(begun_b) if other == who]
        pairs = align([first[at] for at in left], [second[at] for at in right])
        partner |= {left[i]: right[j] for i, j in pairs}
    regions = (_regions(begun_a, partner.keys()), _regions(begun_b, set(partner.values())))
    moved = _moved(first, second, partner)
    partner |= moved
    for key in (keys.loose, action):
        partner |= _close(a, b, partner, regions, key)
    return _in_order(a, b, partner, moved.keys())


def _begun_by(transaction: Transaction) -> str:
    """Return the side that began: the sender of the request, or of an unsolicited message."""
    if transaction.exchange.request_seen:
        return transaction.asked_by
    return {"client": "server", "server": "client"}.get(transaction.asked_by, "")


def _regions(begun: Sequence[str], aligned: Collection[int]) -> list[Region]:
    """Return, for each position of a side, the gap between two aligned transactions of the same sender that it is in."""
    gaps: dict[str, int] = defaultdict(int)
    regions = []
    for at, who in enumerate(begun):
        gaps[who] += at in aligned
        regions.append((who, gaps[who]))
    return regions


def _moved(first: Sequence[int], second: Sequence[int], partner: dict[int, int]) -> dict[int, int]:
    taken = set(partner.values())
    waiting: dict[int, deque[int]] = defaultdict(deque)
    for at, key in enumerate(second):
        if at not in taken:
            waiting[key].append(at)
    pairs = {}
    for at, key in enumerate(first):
        if at not in partner and waiting.get(key):
            pairs[at] = waiting[key].popleft()
    return pairs


def _close(
    a: Sequence[Transaction],
    b: Sequence[Transaction],
    partner: dict[int, int],
    regions: tuple[list[Region], list[Region]],
    key: Callable[[Transaction], Key],
) -> dict[int, int]:
    """Pair, within each gap, the remaining transactions with the same ``key``, in order."""
    taken = set(partner.values())
    waiting: dict[tuple[Region, Key], deque[int]] = defaultdict(deque)
    for at, transaction in enumerate(b):
        if at not in taken:
            waiting[regions[1][at], key(transaction)].append(at)
    pairs = {}
    for at, transaction in enumerate(a):
        if at not in partner:
            queue = waiting.get((regions[0][at], key(transaction)))
            if queue:
                pairs[at] = queue.popleft()
    return pairs


def _in_order(
    a: Sequence[Transaction], b: Sequence[Transaction], partner: dict[int, int], moved: Collection[int]
) -> list[Match]:
    """Return all matches in the order of ``a``; a transaction that only ``b`` has comes after its predecessor in ``b``."""
    away = set(moved)
    taken = set(partner.values())
    matches: list[Match] = []
    done = 0
    for at, transaction in enumerate(a):
        other = partner.get(at)
        if other is not None and at not in away:
            while done < other:
                if done not in taken:
                    matches.append(Match(None, b[done]))
                done += 1
        matches.append(Match(transaction, b[other] if other is not None else None, at in away))
    matches += [Match(None, b[at]) for at in range(done, len(b)) if at not in taken]
    return matches
