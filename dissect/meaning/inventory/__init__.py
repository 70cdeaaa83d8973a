"""Devices: one entry for each station of a capture, with what is known about it, and from which packets."""
