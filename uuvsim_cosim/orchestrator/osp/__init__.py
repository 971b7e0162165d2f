"""OspSystemStructure.xml of the Open Simulation Platform, read as a system.

It may import `orchestrator.plan` and the layers below it. Start reading with `osp.py`.
"""
