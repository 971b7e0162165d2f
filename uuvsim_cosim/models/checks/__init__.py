"""Models against reference data and closed forms: `uuvsim models check`.

It may import everything in `models`. Start reading with `checks.py`.
"""
