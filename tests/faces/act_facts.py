"""The facts of acts: what clients did to devices, or tried to."""

from __future__ import annotations

from typing import Final

from tests.faces.cells import Cell, Fact, Rows, ends, sender, zeek_end
from tests.faces.kinds import COUNT, COUNTS, END, FLAG, TIME, WORD, WORDS

# A row for a fact, with as many cells on a line as fit.
# fmt: off
_act = Rows("act")
_act("number", COUNT, tables="act", zeek="act")
_act("connection", COUNT, link="connection", tables="connection")
_act("uid", WORD, link="uid", zeek="uid")
_act("community_id", WORD, link="community_id", zeek="community_id")
_act("client", END, tables=ends("client_host", "client_port"), zeek=ends("id.orig_h", "id.orig_p"))
_act("server", END, tables=ends("server_host", "server_port"), zeek=ends("id.resp_h", "id.resp_p"))
_act("sender", END, tables=Cell("from_client", sender("client", "server")), zeek=zeek_end("source"))
_act("receiver", END, tables=Cell("from_client", sender("server", "client")), zeek=zeek_end("destination"))
_act("from_client", FLAG, tables="from_client", zeek="is_orig")
_act("begin", TIME, tables="ts_ns", zeek="ts")
_act("end", TIME, tables="end_ns", zeek="end")
_act("first_frame", COUNT, tables="first_frame", zeek="first_frame")
_act("last_frame", COUNT, tables="last_frame", zeek="last_frame")
_act("kind", WORD, tables="kind", zeek="kind")
_act("subject", WORD, tables="subject", zeek="subject")
_act("blocks", WORDS, tables="blocks", zeek="blocks")
_act("bytes", COUNT, tables="bytes", zeek="bytes")
_act("outcome", WORD, tables="outcome", zeek="outcome")
_act("reason", WORD, tables="reason", zeek="reason")
_act("error_code", COUNT, tables="error_code", zeek="error_code")
_act("error_name", WORD, tables="error_name", zeek="error_name")
_act("slug", WORD, tables="slug", zeek="slug")
_act("transactions", COUNTS, tables="transactions", zeek="transactions")
# fmt: on

ROWS: Final[list[Fact]] = _act.rows
