"""`python -m warpchain` is the command `warpchain`."""

import sys

from warpchain.cli import main

sys.exit(main())
