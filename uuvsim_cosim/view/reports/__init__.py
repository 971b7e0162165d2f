"""The one-file reports of runs, studies and trainings.

It may import every other part of `view`. Start reading with `run_report.py`.
"""
