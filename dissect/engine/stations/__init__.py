"""What stations say about themselves: facts that are read from transactions, and the book that keeps them."""
