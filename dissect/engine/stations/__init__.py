"""Statements of stations about themselves: facts that are read from transactions, and the book that stores them."""
