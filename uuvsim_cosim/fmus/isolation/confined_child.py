"""The child process of an isolated FMU: limits its files, then imports and serves as others do."""

from __future__ import annotations

import os
import socket
import sys

from uuvsim_cosim.fmus.isolation.confinement import Rules, apply_files, confine

__all__ = ["main"]


def main() -> None:
    """Serve the parent; the arguments are the memory, a socket, and the rules as text."""
    # Python itself does not try what is refused.
    sys.dont_write_bytecode = True
    report, rules = socket.socket(fileno=int(sys.argv[2])), Rules.of_text(sys.argv[3])
    sys.path[:] = [p for p in sys.path if rules.allow(os.path.realpath(p), write=False)]
    lacking = apply_files(rules)
    # From here on, modules may start threads: the limits hold for these as well.
    from uuvsim_cosim.fmus.isolation import isolated_child
    from uuvsim_cosim.fmus.isolation.confinement import before_loading

    before_loading(lambda: confine(rules, lacking, report))
    isolated_child.main()


if __name__ == "__main__":
    main()
