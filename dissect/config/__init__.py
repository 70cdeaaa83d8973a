"""Shared by all files that users write: the settings, the lines of keys, and suggestions for misspelt names."""
