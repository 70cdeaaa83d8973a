"""A catalogue of a folder of captures: what each file holds in short, so that a question opens only files that can answer it.

`facts` is what is kept of a file, `store` the SQLite database, `update` brings it up to date, `possible` tells which files an
expression can select something from.
"""
