"""Equations of a whole system: linear models, opened loops, dynamics, optimal control.

It may import `orchestrator.plan` and the layers below it. Start reading with `system_map.py`.
"""
