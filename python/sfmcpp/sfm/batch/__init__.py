"""Batch structure from motion: from tracks to a projective world, and from there to a metric one."""
