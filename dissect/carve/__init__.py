"""Blocks out of captures and folders: read, listed, written to files with a manifest, compared."""
