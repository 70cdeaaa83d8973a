"""The whole analyzer as one HTML file: what goes in, how it is put together, and what runs inside it."""
