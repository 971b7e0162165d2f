"""A user's Python class as a component.

It may import `orchestrator.values`. Start reading with `component.py`.
"""
