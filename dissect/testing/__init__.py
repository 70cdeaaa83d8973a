"""Tests of programs that speak S7comm: the pytest plugin, and conversations written by hand (`dissect.testing.talk`).

This module imports nothing, so that a pytest run without the plugin stays fast.
"""
