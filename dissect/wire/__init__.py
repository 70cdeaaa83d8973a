"""The base of all other wings: bytes, codes with names, layouts of structures, text that is safe to show, files of users."""
