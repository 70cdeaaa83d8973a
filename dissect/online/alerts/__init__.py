"""Alerts: rules from a TOML file are applied to live traffic; alerts go to people and programs, at a limited rate."""

from __future__ import annotations

from dissect.online.alerts.alert import Alert
from dissect.online.alerts.dispatcher import Dispatcher
from dissect.online.alerts.engine import AlertEngine
from dissect.online.alerts.loading import AlertRules, RuleError, load_rules
from dissect.online.alerts.rules import Rule

__all__ = ["Alert", "AlertEngine", "AlertRules", "Dispatcher", "Rule", "RuleError", "load_rules"]
