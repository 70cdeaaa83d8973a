"""Logs in Zeek's format, with the columns of cisagov's ICSNPP, and a log of transactions that ICSNPP does not have."""
