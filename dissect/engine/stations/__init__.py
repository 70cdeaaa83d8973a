"""What stations state about themselves: facts that are read from transactions, and the book that stores them."""
