"""What a client may ask of a served co-simulation, whatever the transport.

The table of calls, their arguments and values, and the limits of a server. It may import
`orchestrator` and `errors`, nothing of `bridge` beside it. Start with `service.py`, then
`call_table.py`.
"""
