"""What a run counts, for Prometheus to fetch: `counters` count, `exposition` names and writes, `server` hands out."""
