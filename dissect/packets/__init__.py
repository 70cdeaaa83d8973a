"""Reads packets in order from a file, a pipe or an interface: sources, link layers, IP and TCP."""
