"""The calls that a client can make to a served co-simulation, over every transport.

The table of calls, their arguments and values, and the limits of a server. It may import
`orchestrator` and `errors`, but no other part of `bridge`. Start with `service.py`, then
`call_table.py`.
"""
