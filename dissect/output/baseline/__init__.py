"""Baselines: normal traffic is learned from captures, written as TOML that users can edit, and compared with live traffic."""

from __future__ import annotations

from dissect.output.baseline.comparing import BaselineComparison
from dissect.output.baseline.learn import Learner
from dissect.output.baseline.loading import BaselineError, load_baseline
from dissect.output.baseline.norms import Baseline, PairNorm, merged
from dissect.output.baseline.watch import BaselineWatch, Deviation
from dissect.output.baseline.writing import baseline_toml

__all__ = [
    "Baseline",
    "BaselineComparison",
    "BaselineError",
    "BaselineWatch",
    "Deviation",
    "Learner",
    "PairNorm",
    "baseline_toml",
    "load_baseline",
    "merged",
]
