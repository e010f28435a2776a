"""``python -m polaropt``."""

import sys

from polaropt.cli import main

sys.exit(main())
