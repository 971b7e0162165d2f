"""The master algorithm: initialization, the stepping loop in C, snapshots, restarts.

It may import `orchestrator.plan` and the layers below it. Start reading with `master.py`.
"""
