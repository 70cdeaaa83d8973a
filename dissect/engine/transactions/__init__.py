"""Requests and answers: who asked, who answered, how long it took and what failed."""
