"""The figures of the UUVSim paper: which trainings they need, verdicts, results.

It may import every other part of `learn`. Start reading with `reproduce.py`.
"""
