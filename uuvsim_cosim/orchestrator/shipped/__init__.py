"""Systems of this package, and templates for components of your own.

It may import every package of `orchestrator`. Start reading with `shipped.py`.
"""
