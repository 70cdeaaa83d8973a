"""Who asked, who answered, how long it took and what failed."""
