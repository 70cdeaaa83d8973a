"""What every file has in common that a person writes: the line of a key, and names that are close to a wrong one."""
