"""What came out: trajectories measured against the truth (`evaluation`), and pictures (`plotting`)."""
