"""For tests of programs that speak S7comm: the pytest plugin, and conversations written by hand (`dissect.testing.talk`).

Nothing is imported here: a pytest that does not use the plugin pays for none of it.
"""
