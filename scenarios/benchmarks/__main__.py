"""python -m bullet_tendon.scenarios.benchmarks: see harness."""

import sys

from .harness import main

sys.exit(main())
