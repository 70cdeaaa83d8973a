"""Whole captures: a run over files, parts cut out and made anonymous, what a folder holds, many files side by side."""
