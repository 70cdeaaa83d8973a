"""Whole captures: a run over files, parts cut out and made anonymous, an index of a folder, many files in parallel."""
