"""Values of variables over time: rows of what was read, written and pushed, and summaries of them (docs/values.md)."""
