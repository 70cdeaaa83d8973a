"""Baselines: normal traffic is learned from captures, written as TOML that users can edit, and compared with live traffic."""

from __future__ import annotations

from dissect.baseline.comparing import Comparison
from dissect.baseline.learn import Learner
from dissect.baseline.loading import BaselineError, load_baseline
from dissect.baseline.norms import Baseline, PairNorm, merged
from dissect.baseline.watch import BaselineWatch, Deviation
from dissect.baseline.writing import baseline_toml

__all__ = [
    "Baseline",
    "BaselineError",
    "BaselineWatch",
    "Comparison",
    "Deviation",
    "Learner",
    "PairNorm",
    "baseline_toml",
    "load_baseline",
    "merged",
]
