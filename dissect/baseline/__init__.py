"""What is normal on a line: learned from captures, written as TOML a person edits, and compared with what passes now."""

from __future__ import annotations

from dissect.baseline.learn import Learner
from dissect.baseline.loading import BaselineError, load_baseline
from dissect.baseline.norms import Baseline, PairNorm, merged
from dissect.baseline.watch import BaselineWatch, Deviation
from dissect.baseline.writing import baseline_toml

__all__ = [
    "Baseline",
    "BaselineError",
    "BaselineWatch",
    "Deviation",
    "Learner",
    "PairNorm",
    "baseline_toml",
    "load_baseline",
    "merged",
]
