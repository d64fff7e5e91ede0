"""One module for each side of the comparison, each the program of a process of its own."""
