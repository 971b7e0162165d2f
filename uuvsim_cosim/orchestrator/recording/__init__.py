"""Recordings: written during a run, read, compared, exported.

It may import `orchestrator.master` and the layers below it. Start reading with `recorder.py`,
`recording_reader.py`.
"""
