"""Captures that may be shown to others: addresses, names, passwords and values replaced, everything else as it was."""
