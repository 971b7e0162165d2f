"""``python -m uuvsim_cosim`` is the command ``uuvsim``."""

from uuvsim_cosim.cli import main

if __name__ == "__main__":
    main()
