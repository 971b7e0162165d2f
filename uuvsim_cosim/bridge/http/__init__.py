"""The HTTP server: JSON answers, the page with live values, and the pilot's page.

It may import `bridge.calls`, `bridge.access`, `bridge.tcp`. Start reading with `server.py`, then
`request_handler.py`.
"""
