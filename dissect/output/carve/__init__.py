"""Blocks from captures and folders: reads them, lists them, writes them to files with a manifest, compares them."""
