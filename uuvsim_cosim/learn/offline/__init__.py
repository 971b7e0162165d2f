"""Learning from a dataset alone: behaviour cloning, IQL, decision transformer.

It may import `learn.data`, `learn.training` and lower parts. Start reading with `offline.py`.
"""
