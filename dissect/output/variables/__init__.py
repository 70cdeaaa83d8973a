"""Values of variables over time: a row for each value that was read, written or pushed, and summaries (docs/values.md)."""
