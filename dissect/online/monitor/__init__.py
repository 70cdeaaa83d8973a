"""The screens of `s7dissect monitor`.

`model.Model` keeps a bounded state of the events and does not depend on a terminal. `rows` and `details` make text of that
state, in the words of the reports. `panes`, `screens` and `app` show the text; only they import textual.
"""
