"""Benchmarks: made captures, endless streams, and the commands that measure on them. Nothing here is installed."""
