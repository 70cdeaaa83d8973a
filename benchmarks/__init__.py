"""Benchmarks: synthetic captures, endless streams, and the commands that measure with them. Nothing here is installed."""
