"""Files of users: settings, line numbers of keys and hints for typing errors, and how files that users name are written."""
