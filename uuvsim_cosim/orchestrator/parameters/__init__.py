"""Parameter sets and mappings of SSP (.ssv, .ssm) and their XML.

It may import `orchestrator.values`. Start reading with `ssv.py`.
"""
