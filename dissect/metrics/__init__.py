"""What a run counts, for Prometheus to fetch: `counters` count, `families` name, `exposition` writes, `server` hands out."""
