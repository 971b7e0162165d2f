"""The summary names each comparison of the freeze that was reduced, also where all tests pass."""

from __future__ import annotations

from typing import Any


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Write what was not compared, and why."""
    for reports in terminalreporter.stats.values():
        for report in reports:
            for name, text in getattr(report, "user_properties", ()):
                if name == "not compared" and getattr(report, "when", "") == "call":
                    terminalreporter.write_line(f"{report.nodeid}: {text}", yellow=True)
