"""SSP files (.ssd, .ssp), read and written.

It may import `orchestrator.plan` and the layers below it. Start reading with `ssd.py`,
`ssd_reader.py`.
"""
