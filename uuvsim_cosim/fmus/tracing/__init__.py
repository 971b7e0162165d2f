"""Log of every FMI call of an FMU.

It may import `fmus.instantiation` and what is below it. Start reading with `trace.py`.
"""
