"""Usual questions about a plant, with the SQL that answers them: `s7dissect sql` takes their names and lists them."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from datetime import UTC, datetime
from typing import Final, NamedTuple
from zoneinfo import ZoneInfo

from dissect.meaning.select.literals import place_of
from dissect.protocols.s7.tables import AREA_LETTERS, BIT, ELEMENT_OCTETS, TRANSPORT_SIZES


class Parameter(NamedTuple):
    """A word after the name of a question: its name, its meaning, and its default.

    The SQL reads it as ``getvariable('name')`` and repeats the default, so that it also runs alone. ``check`` raises ValueError
    or LookupError for an invalid text.
    """

    name: str
    about: str
    default: str
    check: Callable[[str], object] = str

    @property
    def said(self) -> str:
        """The word, for a person: ``from_hour: hour at which the shift begins (6)``."""
        return f"{self.name}: {self.about}" + (f" ({self.default})" if self.default else "")


class Question(NamedTuple):
    """A question: its name, the question as a sentence, a remark on the answer, and the SQL.

    ``none`` says why there is no answer; ``parameters`` are the words after the name.
    """

    name: str
    sentence: str
    note: str
    none: str
    sql: str
    parameters: tuple[Parameter, ...] = ()


def _hour(text: str) -> int:
    hour = int(text)
    if not 0 <= hour <= 24:
        raise ValueError(text)
    return hour


#: How many bits an item has, by its type and count; timers and counters are counted.
_BITS: Final = "CASE i.type {} ELSE 8 END * coalesce(i.count, 1)".format(
    " ".join(
        [
            f"WHEN '{TRANSPORT_SIZES.name(code)}' THEN {1 if code == BIT else 8 * octets}"
            for code, octets in sorted(ELEMENT_OCTETS.items())
            if octets != 1 or code == BIT
        ]
    )
)
#: True if an item has the name or tag ``address``, or a bit of that address, which `_place` gives in numbers.
_TOUCHES: Final = f"""(upper(i.address) = upper(getvariable('address')) OR upper(i.name) = upper(getvariable('address'))
    OR (i.area = getvariable('area') AND i.db IS NOT DISTINCT FROM getvariable('db')::BIGINT
        AND CASE WHEN i.bit IS NULL THEN i.byte ELSE 8 * i.byte + i.bit END < getvariable('end_bit')::BIGINT
        AND CASE WHEN i.bit IS NULL THEN i.byte + coalesce(i.count, 1)
                 ELSE 8 * i.byte + i.bit + {_BITS} END > getvariable('first_bit')::BIGINT))"""


_ALL: Final = (
    Question(
        "slowest",
        "Which requests of each PLC take longest?",
        "The three slowest of each PLC, by what they ask for; a PLC answers a request as a whole, so the time is not that of "
        "one item. Pairs that are only likely have no response time.",
        "No request with items was answered for sure.",
        """
WITH asked AS (
  SELECT t.transaction, t.server_host, t.latency_ns, i.operation, count(*) AS items,
         string_agg(coalesce(i.name, i.address) || CASE WHEN i.count > 1 THEN ' x' || i.count ELSE '' END, ', ' ORDER BY i.item)
         AS what
  FROM transactions t JOIN items i USING (transaction) WHERE t.latency_ns IS NOT NULL GROUP BY ALL)
SELECT server_host, operation, what, items, count(*) AS times, round(median(latency_ns) / 1e6, 3) AS median_ms,
       round(max(latency_ns) / 1e6, 3) AS worst_ms
FROM asked GROUP BY server_host, operation, what, items
QUALIFY row_number() OVER (PARTITION BY server_host ORDER BY max(latency_ns) DESC, what, operation) <= 3
ORDER BY server_host, worst_ms DESC, what, operation""",
    ),
    Question(
        "slow-items",
        "Which items stand in slow requests more often than chance?",
        "Slow is the slowest tenth of the requests of a PLC. Of items that stand in 20 requests at least, and not in all, "
        "those that stand in more slow ones than chance explains (by two standard deviations). That does not prove that they "
        "are why.",
        "No item stands in slow requests more often than chance explains. It takes items that are in 20 requests at least and "
        "not in all.",
        """
WITH asked AS (
  SELECT DISTINCT i.transaction, i.server_host, coalesce(i.name, i.address) AS what, t.latency_ns
  FROM items i JOIN transactions t USING (transaction) WHERE t.latency_ns IS NOT NULL AND i.address IS NOT NULL),
bound AS (
  SELECT server_host, quantile_cont(latency_ns, 0.9) AS slow_ns, count(*) AS requests
  FROM (SELECT DISTINCT transaction, server_host, latency_ns FROM asked) GROUP BY server_host),
counted AS (
  SELECT server_host, what, count(*) AS times, count(*) FILTER (latency_ns >= slow_ns) AS slow, any_value(requests) AS requests
  FROM asked JOIN bound USING (server_host) GROUP BY server_host, what)
SELECT server_host, what, times, slow, round(times * 0.1, 1) AS by_chance, requests
FROM counted
WHERE times >= 20 AND times < requests AND slow > times * 0.1 + 2 * sqrt(times * 0.09)
ORDER BY slow - times * 0.1 DESC, server_host, what""",
    ),
    Question(
        "overlaps",
        "Which polls begin before the same poll before them was answered?",
        "Such a client polls faster than the PLC answers.",
        "No poll began before the same poll before it was answered.",
        """
WITH asked AS (
  SELECT t.transaction, t.connection, t.ts_ns, t.response_ns, t.client_host, t.server_host, t.certainty,
         string_agg(i.address || ' x' || coalesce(i.count, 1), ', ' ORDER BY i.item) AS what
  FROM transactions t JOIN items i USING (transaction)
  WHERE i.operation = 'read' GROUP BY ALL),
polls AS (
  SELECT *, lead(ts_ns) OVER (PARTITION BY connection, what ORDER BY ts_ns, transaction) AS next_ns FROM asked)
SELECT client_host, server_host, what, count(*) AS polls,
       count(*) FILTER (next_ns < response_ns AND certainty = 'sure') AS overlapping
FROM polls GROUP BY ALL HAVING overlapping > 0
ORDER BY overlapping DESC, client_host, server_host, what""",
    ),
    Question(
        "off-shift",
        "What was written outside the shift?",
        "The shift is 6 to 22 o'clock in UTC if nothing else is said: `off-shift Europe/Berlin 22 6` is a night shift there.",
        "Nothing was written outside the shift.",
        """
WITH written AS (
  SELECT *, hour(ts AT TIME ZONE coalesce(getvariable('zone'), 'UTC')) AS hour_there,
         coalesce(getvariable('from_hour')::INTEGER, 6) AS begins, coalesce(getvariable('to_hour')::INTEGER, 22) AS ends
  FROM items WHERE operation = 'write' AND NOT refused AND address IS NOT NULL)
SELECT ts, client_host, server_host, coalesce(name, address) AS written, number, text
FROM written
WHERE NOT CASE WHEN begins < ends THEN hour_there >= begins AND hour_there < ends
               ELSE hour_there >= begins OR hour_there < ends END
ORDER BY ts_ns, transaction, item""",
        (
            Parameter("zone", "time zone by its name, such as Europe/Berlin", "UTC", ZoneInfo),
            Parameter("from_hour", "hour at which the shift begins", "6", _hour),
            Parameter("to_hour", "hour at which it ends", "22", _hour),
        ),
    ),
    Question(
        "who",
        "Who wrote an address, and when?",
        "Writes of the tag, or of any place that has a bit in common with the address, refused ones included; with a time "
        "those of a minute before and after.",
        "Nobody wrote that address or tag.",
        f"""
WITH wanted AS (SELECT try_cast(nullif(getvariable('time'), '') AS TIMESTAMP) AS moment)
SELECT i.ts, i.client_host, i.server_host, i.address, i.name, i.number, i.text, i.data, i.refused
FROM items i, wanted w
WHERE i.operation = 'write' AND {_TOUCHES}
  AND (w.moment IS NULL OR i.ts BETWEEN w.moment - INTERVAL 1 MINUTE AND w.moment + INTERVAL 1 MINUTE)
ORDER BY i.ts_ns, i.transaction, i.item""",  # noqa: S608 - our own tables
        (
            Parameter("address", "address or tag, such as DB10.DBW4", ""),
            Parameter(
                "time",
                "a time, such as 2026-11-28 14:03, in UTC or with a zone",
                "",
                datetime.fromisoformat,
            ),
        ),
    ),
    Question(
        "writers",
        "Which addresses have more than one writer?",
        "Two clients that write the same address overwrite each other.",
        "No address has more than one writer.",
        """
SELECT server_host, address, count(DISTINCT client_host) AS writers, list(DISTINCT client_host ORDER BY client_host) AS hosts,
       count(*) AS writes
FROM items WHERE operation = 'write' AND NOT refused AND address IS NOT NULL
GROUP BY server_host, address HAVING writers > 1
ORDER BY writes DESC, server_host, address""",
    ),
    Question(
        "refused",
        "Which items does a PLC refuse, why, and to whom?",
        "An address that is always refused does not exist in the program that runs there.",
        "No item was refused.",
        """
SELECT i.server_host, i.client_host, i.address, coalesce(i.return_name, t.errors[1]) AS return_name, count(*) AS times,
       min(i.ts) AS first_time, max(i.ts) AS last_time
FROM items i JOIN transactions t USING (transaction)
WHERE i.refused AND i.certainty IS DISTINCT FROM 'likely'
GROUP BY ALL ORDER BY times DESC, i.server_host, i.client_host, i.address""",
    ),
    Question(
        "unanswered",
        "Which connections leave requests without an answer?",
        "The share is that of all requests of the connection. Those whose answer was not due yet at the end are not meant.",
        "No request was left without an answer that was due.",
        """
SELECT connection, client_host, server_host, count(*) FILTER (outcome = 'unanswered' AND failed) AS unanswered,
       round(100.0 * count(*) FILTER (outcome = 'unanswered' AND failed) / count(*), 1) AS percent,
       max(reason) FILTER (outcome = 'unanswered' AND failed) AS reason
FROM transactions WHERE outcome IN ('answered', 'unanswered')
GROUP BY ALL HAVING unanswered > 0
ORDER BY unanswered DESC, connection""",
    ),
    Question(
        "periods",
        "How often is each address polled, and how steadily?",
        "A row for each address and length that the same client asked for three times at least. The period is the middle pause "
        "between two requests; irregular where pauses spread more than they last. What is pushed comes on change.",
        "No address was asked for three times by one client.",
        """
WITH polls AS (
  SELECT DISTINCT client_host, server_host, connection, coalesce(name, address) AS what, coalesce(count, 1) AS length,
         operation, ts_ns
  FROM items WHERE operation IN ('read', 'notify') AND address IS NOT NULL),
pauses AS (
  SELECT *, ts_ns - lag(ts_ns) OVER (PARTITION BY connection, operation, what, length ORDER BY ts_ns) AS pause FROM polls)
SELECT client_host, server_host, what, length, count(*) AS times, round(median(pause) / 1e6, 3) AS period_ms,
       round(stddev_pop(pause) / 1e6, 3) AS spread_ms,
       CASE WHEN operation = 'notify' THEN 'on change' WHEN stddev_pop(pause) > avg(pause) THEN 'irregular' ELSE 'steady' END
       AS how
FROM pauses
GROUP BY client_host, server_host, what, length, operation HAVING count(pause) >= 2
ORDER BY period_ms, client_host, server_host, what, length""",
    ),
    Question(
        "gaps",
        "When did a polled value not arrive?",
        "Refused, unanswered, lost (the answer was not captured), or late: asked for after more than twice the middle pause. "
        "`gaps DB10.DBW4` asks about what has a bit in common with it, or about a tag.",
        "No polled value is missing: each arrived, as often as usual, or there were none.",
        f"""
WITH polls AS (
  SELECT i.ts, i.ts_ns, i.transaction, i.connection, i.client_host, i.server_host, coalesce(i.name, i.address) AS what,
         coalesce(i.count, 1) AS length,
         CASE WHEN t.reason IN ('hole', 'one_sided') THEN 'lost' WHEN t.outcome = 'unanswered' AND t.failed THEN 'unanswered'
              WHEN i.refused THEN 'refused' WHEN t.outcome = 'answered' THEN 'arrived' END AS state
  FROM items i JOIN transactions t USING (transaction)
  WHERE i.operation = 'read' AND i.address IS NOT NULL AND (getvariable('address') IS NULL OR {_TOUCHES})),
steps AS (
  SELECT *, ts_ns - lag(ts_ns) OVER (PARTITION BY connection, what, length ORDER BY ts_ns, transaction) AS pause FROM polls),
usual AS (
  SELECT connection, what, length, median(pause) AS period FROM steps WHERE pause > 0 GROUP BY ALL HAVING count(*) >= 2)
SELECT ts, client_host, server_host, what, length, CASE WHEN state = 'arrived' THEN 'late' ELSE state END AS how,
       round(pause / 1e6, 3) AS pause_ms, round(period / 1e6, 3) AS period_ms
FROM steps LEFT JOIN usual USING (connection, what, length)
WHERE state IN ('refused', 'unanswered', 'lost') OR (state = 'arrived' AND pause > 2 * period)
ORDER BY ts_ns, transaction, what, length""",  # noqa: S608 - our own tables
        (Parameter("address", "address or tag, such as DB10.DBW4; all where it is not given", ""),),
    ),
    Question(
        "changes",
        "Which values change, how often, and within what bounds?",
        "A row for each variable that changed; bounds only of numbers. A first value is no change. Pairs that are only likely "
        "are left out.",
        "No value changed.",
        """
SELECT server_host, coalesce(name, address) AS what, count(*) AS seen, count(*) FILTER (changed) AS changes,
       count(DISTINCT coalesce(number::VARCHAR, text, hex(data))) AS different,
       min(number) AS lowest, max(number) AS highest,
       arg_max(coalesce(number::VARCHAR, text, hex(data)), ts_ns) AS latest
FROM values
GROUP BY server_host, what HAVING changes > 0
ORDER BY changes DESC, server_host, what""",
    ),
    Question(
        "interventions",
        "Who loaded, read out, stopped, forced or deleted something, and when?",
        "What was refused or not answered is among them; the column outcome says so.",
        "Nobody loaded, read out, stopped or deleted anything.",
        """
SELECT ts, client_host, server_host, kind, subject, bytes, outcome
FROM acts
ORDER BY ts_ns, act""",
    ),
    Question(
        "ioc",
        "Which addresses did what an attacker would do, and when?",
        "Acts, and findings of the kind security that are none, by the address that caused them, with what `devices` says that "
        "it is. An engineer may have done the same.",
        "Nobody did anything that an attacker would do.",
        """
WITH done AS (
  SELECT CASE WHEN from_client THEN client_host ELSE server_host END AS address, kind AS act, outcome,
         CASE WHEN from_client THEN server_host ELSE client_host END AS other, 1 AS times, ts, "end" FROM acts
  UNION ALL
  SELECT client_host, slug, NULL, server_host, events, ts, "end" FROM finding_counts
  WHERE scope = 'pair' AND kind = 'security' AND slug NOT IN ('security.stopped', 'security.mode_changed')
    AND slug NOT IN (SELECT slug FROM acts WHERE slug IS NOT NULL))
SELECT address, any_value(d.role) AS role, act, outcome, list(DISTINCT other ORDER BY other) AS on_hosts,
       sum(times)::BIGINT AS times, min(done.ts) AS first_time, max(done."end") AS last_time
FROM done LEFT JOIN devices d USING (address)
GROUP BY address, act, outcome
ORDER BY first_time, address, act, outcome""",
    ),
    Question(
        "talkers",
        "Who talks to whom, how much, and how well?",
        "Bytes are TCP payload both ways.",
        "There are no connections.",
        """
SELECT client_host, server_host, count(*) AS connections, sum(client_bytes + server_bytes)::BIGINT AS bytes,
       sum(answered)::BIGINT AS answered, sum(with_errors)::BIGINT AS with_errors, sum(missing_bytes)::BIGINT AS missing_bytes
FROM connections GROUP BY ALL
ORDER BY bytes DESC, client_host, server_host""",
    ),
)

#: All questions by name.
QUESTIONS: Final[dict[str, Question]] = {question.name: question for question in _ALL}


def named(text: str, local: bool = False) -> tuple[Question, dict[str, str]] | None:
    """Return the question that a text names, and the words after the name by their names; None if it names none.

    A time without a zone is in UTC or, with ``local``, in the zone of this machine. Raises ValueError, with a sentence, for
    words that the question does not accept.
    """
    first = text.split(maxsplit=1)[0] if text.strip() else ""
    question = QUESTIONS.get(first)
    if question is None:
        return None
    name, *words = shlex.split(text)
    if len(words) > len(question.parameters):
        takes = " ".join([f"[{one.name}]" for one in question.parameters]) or "nothing more"
        message = f"the question {name} takes {takes}, and not {words[len(question.parameters)]!r}"
        raise ValueError(message)
    given = dict(zip([one.name for one in question.parameters], words, strict=False))
    for one in question.parameters:
        try:
            one.check(given.get(one.name, one.default) or "")
        except (ValueError, LookupError):
            if one.name in given:
                message = f"the question {name} takes {one.about}, and not {given[one.name]!r}"
                raise ValueError(message) from None
    if name == "who" and not given:
        raise ValueError("the question who takes an address or tag, such as 'who DB10.DBW4'")
    if given.get("time"):
        try:
            given["time"] = _in_utc(given["time"], local)
        except OverflowError:
            raise ValueError(f"no calendar has the time {given['time']!r} in UTC") from None
    return question, {**given, **_place(given.get("address", ""))}


def _in_utc(text: str, local: bool) -> str:
    """Return a time as the tables have it."""
    moment = datetime.fromisoformat(text)
    if moment.tzinfo is None and not local:
        return text
    return moment.astimezone(UTC).replace(tzinfo=None).isoformat(" ")


def _place(address: str) -> dict[str, str]:
    """Return the variables that describe an address in numbers; empty for a tag, and for a text that is not an S7 address."""
    place = place_of(address) if address else None
    if place is None or place.area < 0:
        return {}
    return {
        "area": AREA_LETTERS[place.area],
        **({"db": str(place.db)} if place.db > 0 else {}),
        "first_bit": str(place.start),
        "end_bit": str(place.start + place.size),
    }
