"""Model Exchange FMUs, integrated here with their events.

It may import `fmus.importer`. Start reading with `component.py`.
"""
