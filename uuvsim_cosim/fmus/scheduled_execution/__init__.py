"""Scheduled Execution FMUs, whose model partitions are activated here at the ticks of clocks.

It may import `fmus.importer` and `fmus.model_exchange`. Start reading with `component.py`.
"""
