"""`python -m sfmcpp`: the command line."""

import sys

from sfmcpp.cli.main import main

sys.exit(main())
