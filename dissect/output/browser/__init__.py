"""The whole analyzer as one HTML file: its contents, how it is built, and the code that runs inside it."""
