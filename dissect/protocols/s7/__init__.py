"""S7comm messages and the tables that name what they hold."""
