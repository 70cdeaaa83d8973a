"""Logs as Zeek writes them, in the columns of cisagov's ICSNPP, and one of paired transactions."""
