"""The commands of `uuvsim`, one file each.

Heavy imports stand inside the functions, so that `uuvsim --help` stays fast. Options, tables and
progress that commands share are in `shared/`. It may import everything but `cli`, which names the
commands. Start with `run/run.py`.
"""
