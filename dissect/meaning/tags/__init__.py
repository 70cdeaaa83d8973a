"""Tags: names, types and units for addresses, from the files of S7 tools (docs/tags.md), and values decoded by them."""

from __future__ import annotations

from dissect.meaning.tags.loading import TagError, TagSet, load_tags

__all__ = ["TagError", "TagSet", "load_tags"]
