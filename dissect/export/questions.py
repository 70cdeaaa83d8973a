"""Usual questions about a plant, with the SQL that answers them: `s7dissect sql` takes their names and lists them."""

from __future__ import annotations

from typing import Final, NamedTuple


class Question(NamedTuple):
    """A question: its name, the question as a sentence, what to change in the SQL for one's own plant, and the SQL."""

    name: str
    sentence: str
    note: str
    sql: str


_ALL: Final = (
    Question(
        "slowest",
        "Which addresses of each PLC take longest to read or write?",
        "The three slowest of each PLC; with `--tags` the column `name` says what they are. Pairs that are only likely have no "
        "response time.",
        """
SELECT i.server_host, i.address, any_value(i.name) AS name, count(*) AS times,
       round(avg(t.latency_ns) / 1e6, 3) AS mean_ms, round(max(t.latency_ns) / 1e6, 3) AS worst_ms
FROM items i JOIN transactions t USING (transaction)
WHERE t.latency_ns IS NOT NULL
GROUP BY i.server_host, i.address
QUALIFY row_number() OVER (PARTITION BY i.server_host ORDER BY max(t.latency_ns) DESC, i.address) <= 3
ORDER BY i.server_host, worst_ms DESC, i.address""",
    ),
    Question(
        "overlaps",
        "Which polls begin before the same poll before them was answered?",
        "Such a client polls faster than the PLC answers.",
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
        "The shift is 6 to 22 o'clock in UTC here; `hour(ts AT TIME ZONE 'UTC' AT TIME ZONE 'Europe/Berlin')` is local time.",
        """
SELECT ts, client_host, server_host, coalesce(name, address) AS written, number, text
FROM items
WHERE operation = 'write' AND NOT refused AND hour(ts) NOT BETWEEN 6 AND 21
ORDER BY ts_ns, transaction, item""",
    ),
    Question(
        "writers",
        "Which addresses have more than one writer?",
        "Two clients that write the same address overwrite each other.",
        """
SELECT server_host, address, count(DISTINCT client_host) AS writers, list(DISTINCT client_host ORDER BY client_host) AS hosts,
       count(*) AS writes
FROM items WHERE operation = 'write' AND NOT refused
GROUP BY server_host, address HAVING writers > 1
ORDER BY writes DESC, server_host, address""",
    ),
    Question(
        "refused",
        "Which items does a PLC refuse, why, and to whom?",
        "An address that is always refused does not exist in the program that runs there.",
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
        "Addresses that are read at least three times by the same client.",
        """
WITH reads AS (
  SELECT client_host, server_host, address,
         ts_ns - lag(ts_ns) OVER (PARTITION BY connection, address ORDER BY ts_ns, transaction) AS pause
  FROM items WHERE operation = 'read')
SELECT client_host, server_host, address, count(*) AS reads, round(median(pause) / 1e6, 3) AS period_ms,
       round(quantile_cont(pause, 0.95) / 1e6 - median(pause) / 1e6, 3) AS jitter_ms
FROM reads
GROUP BY ALL HAVING count(pause) >= 2
ORDER BY period_ms, client_host, server_host, address""",
    ),
    Question(
        "changes",
        "Which values change, and within what bounds?",
        "Numbers only; texts and arrays stand in the columns `text` and `data`. Pairs that are only likely are left out.",
        """
SELECT server_host, coalesce(name, address) AS what, count(*) AS seen, count(DISTINCT number) AS different,
       min(number) AS lowest, max(number) AS highest, arg_max(number, ts_ns) AS latest
FROM items WHERE number IS NOT NULL AND NOT refused AND certainty IS DISTINCT FROM 'likely'
GROUP BY server_host, what HAVING different > 1
ORDER BY different DESC, server_host, what""",
    ),
    Question(
        "interventions",
        "Who loaded, read out, stopped, forced or deleted something, and when?",
        "What was refused or not answered is among them; the column outcome says so.",
        """
SELECT ts, client_host, server_host, kind, subject, bytes, outcome
FROM acts
ORDER BY ts_ns, act""",
    ),
    Question(
        "talkers",
        "Who talks to whom, how much, and how well?",
        "Bytes are TCP payload both ways.",
        """
SELECT client_host, server_host, count(*) AS connections, sum(client_bytes + server_bytes)::BIGINT AS bytes,
       sum(answered)::BIGINT AS answered, sum(with_errors)::BIGINT AS with_errors, sum(missing_bytes)::BIGINT AS missing_bytes
FROM connections GROUP BY ALL
ORDER BY bytes DESC, client_host, server_host""",
    ),
)

#: All questions by name.
QUESTIONS: Final[dict[str, Question]] = {question.name: question for question in _ALL}
