"""Pages that open in any browser from their file alone, without a network, a server or a library."""
