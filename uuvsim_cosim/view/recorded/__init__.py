"""The recorded signals of a run by name, and its figures of merit.

It may import `orchestrator`. Start reading with `traces.py`.
"""
