"""MC7: the block code of S7-300 and S7-400, as STL, assembled, compared (reference sheet mc7.md)."""
