"""Generation of C for one step of a plan over lanes of environments.

It may import `orchestrator`, `fmus`, `models`. Start reading with `driver.py`.
"""
