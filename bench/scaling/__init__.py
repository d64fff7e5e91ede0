"""What `bench/scale.py` is made of: cases, one run in a process of its own, kept results, tables."""
