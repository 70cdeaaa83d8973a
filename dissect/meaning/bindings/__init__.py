"""Places of SCD in traffic (`bindings_file`), and the decoding of SCD there (`engine`)."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from dissect.meaning.bindings.bindings_file import BindingError, load_bindings

if TYPE_CHECKING:
    from dissect.meaning.bindings.engine import ScdCarrier
    from dissect.scd.dictionary import Dictionary

__all__ = ["BindingError", "load_bindings", "load_carrier"]


def load_carrier(scd: str | os.PathLike[str] | Dictionary, bind: str | os.PathLike[str]) -> ScdCarrier:
    """Return a decoder for SCD with the dictionary ``scd`` (or its file), where the file ``bind`` says that it is carried.

    Raises `DictionaryError`, `BindingError`, or OSError if a file cannot be read.
    """
    from dissect.meaning.bindings.engine import ScdCarrier
    from dissect.scd.loading import load

    dictionary = load(scd) if isinstance(scd, (str, os.PathLike)) else scd
    return ScdCarrier(dictionary, load_bindings(bind, dictionary))
