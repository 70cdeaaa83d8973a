"""What stations say of themselves: facts read from transactions, and what is remembered of them."""
