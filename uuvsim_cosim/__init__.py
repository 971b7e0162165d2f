"""uuvsim-cosim: unmanned underwater vehicles as a co-simulation of exchangeable parts."""

from uuvsim_cosim._version import __version__

__all__ = ["__version__"]
