"""Facts: for each kind of record one table of what it tells, from which the faces are made."""
