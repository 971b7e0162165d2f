"""Scenarios and inputs over time: events and signals that change a system during a run.

It may import `orchestrator.master` and the layers below it. Start reading with `scenario.py`.
"""
