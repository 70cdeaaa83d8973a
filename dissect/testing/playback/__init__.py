"""Recorded sessions played again: the server's side and the client's."""
