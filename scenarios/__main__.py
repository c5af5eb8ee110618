"""python -m bullet_tendon.scenarios: see runner."""

import sys

from .runner import main

sys.exit(main())
