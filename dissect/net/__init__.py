"""Addresses and sockets shared by the rooms that speak TCP."""
