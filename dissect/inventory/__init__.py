"""Devices: one entry for each station of a capture, with what is known of it and by which packets."""
