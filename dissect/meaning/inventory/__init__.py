"""Devices: one entry for each station of a capture, with its facts and the packets that show them."""
