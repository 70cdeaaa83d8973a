"""S7comm messages, and the tables that name their contents."""
