"""Community ID by its published vectors; uids that stay."""

from __future__ import annotations

import re

from dissect.meaning.facts.keys import community_id
from dissect.packets.tcp.stream import Endpoint
from tests.cases import each
from tests.meaning.report.support import ROOT
from tests.output.export.support import rows_of

#: Addresses and ports, and the id: of the specification's own software and of tshark, which agree.
VECTORS = (
    ("ac110002", 33028, "ac110002", 102, "1:xKk9rLAlptFjQB50+/lqLXM7tJ4="),
    ("86d93d83", 51212, "86d93dd3", 102, "1:J2l9f4YrmSbWff3ILdntcGPgpDo="),
    ("c0a80021", 54670, "c0a80001", 102, "1:3Xi2mr/Ng5XA4bBUY3GUr4fPJxY="),
    ("c0a80003", 49154, "c0a80001", 102, "1:S+8uu6pK6S3nfJyxcW4cvf+ilV8="),
    ("fe80" + 27 * "0" + "1", 1024, "fe80" + 27 * "0" + "2", 102, "1:iL8Gc1HJA4vmRBu+iZamFP3DOZU="),
)


@each(("one", "port", "other", "other_port", "wanted"), VECTORS)
def test_community_id(one: str, port: int, other: str, other_port: int, wanted: str) -> None:
    ends = Endpoint(bytes.fromhex(one), port), Endpoint(bytes.fromhex(other), other_port)
    assert community_id(ends[0], ends[1]) == community_id(ends[1], ends[0]) == wanted
    assert community_id(ends[0], ends[1], seed=1) != wanted
    assert community_id(ends[0], ends[1], 17) != wanted


def test_a_uid_is_the_same_in_each_run_and_of_one_connection_only() -> None:
    paths = [ROOT / "captures" / name for name in ("transfer.pcapng", "szl.pcapng", "nodes7-write.pcapng")]
    uids = [row["uid"] for path in paths for row in rows_of(path)["connections"]]
    assert uids == [row["uid"] for row in rows_of(*paths)["connections"]]
    assert len(set(uids)) == len(uids)
    for uid in uids:
        assert re.fullmatch(r"C[0-9a-zA-Z]{8,17}", uid)
