"""Facts: one table of facts for each kind of record, from which all outputs are made."""
