"""``python -m uuvsim_cosim.envs.conformance`` examines the environments that are named."""

import sys

from uuvsim_cosim.envs.conformance.suite import main

sys.exit(main())
