"""Files of users: settings, lines of keys and hints for those that they write, and how those that they name are written."""
