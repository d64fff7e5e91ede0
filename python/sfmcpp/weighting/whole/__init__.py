"""Weights of constraint groups for a whole adjustment, chosen from its data."""
