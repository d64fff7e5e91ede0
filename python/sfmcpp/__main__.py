"""`python -m sfmcpp`: the command line."""

import sys

from sfmcpp.cli.main import main

code = main()
# An interrupt within text that is run, such as the methods of a data class, is noted by the interpreter,
# which then ends itself by SIGINT, whatever the code; until it runs a text without one.
exec("")
sys.exit(code)
