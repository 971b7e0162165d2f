"""`uuvsim fmu check` and the simulation of a single FMU.

It may import every other part of `fmus`. Start reading with `check_fmu.py`, `simulate_fmu.py`.
"""
