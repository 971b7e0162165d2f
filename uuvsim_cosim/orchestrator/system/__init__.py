"""A system as a value: elements, connections, sources of components, validation.

It may import `orchestrator.python`, `orchestrator.parameters`, `orchestrator.values`.
`elements.py` holds the parts, `system.py` checks and edits them: start reading there. The
readers and writers of files are above this package; `formats.py` names them.
"""
