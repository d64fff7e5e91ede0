"""The command line: `sfmcpp solve`, `sfmcpp convert`, `sfmcpp demo`."""
