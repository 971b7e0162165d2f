"""Views: figures of merit, plots, reports, block diagrams, and runs in three dimensions.

It may import `envs`, `bridge`, `kernels`, `scene`, `orchestrator` and below. Start with
`reports/run_report.py`, `scene3d/scene.py`, `diagram/diagram.py`.
"""
