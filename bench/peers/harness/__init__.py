"""What every peer shares: the protocol, the BAL file, processes, measurement, tables and pictures."""
