"""Addresses and sockets, shared by the packages that use TCP themselves."""
