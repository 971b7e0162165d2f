"""The plan of a system: paths, transfers, order of initialization, algebraic loops.

It may import `orchestrator.system` and the layers below it. Start reading with `flatten.py`,
then `plan.py`.
"""
