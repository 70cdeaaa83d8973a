"""A catalogue of a folder of captures: a summary of each file, so that a query only opens files that can answer it.

`facts` defines the summary of a file, `store` the SQLite database; `update` updates it, `possible` determines the files in
which an expression can select something.
"""
