"""The Zenoh server: calls as queries, states as published blocks.

It may import `bridge.calls`, `bridge.access`, `bridge.server`. Start reading with `bridge.py`.
"""
