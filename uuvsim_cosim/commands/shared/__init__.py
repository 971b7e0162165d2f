"""Shared parts of commands: tables on the terminal, options, progress, the `--json` answer.

It may import anything below `commands`. Start reading with `terminal.py`.
"""
