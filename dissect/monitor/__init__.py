"""The screens of `s7dissect monitor`.

`model.Model` folds events into bounded state and knows nothing of a terminal; `rows` and `details` make text of it,
in the words of the reports; `panes`, `screens` and `app` show that text with textual, and only they import it.
"""
