"""A declaration simulated by CasADi, linearised, trimmed.

It may import `models.declaration`. Start reading with `simulate.py`.
"""
