"""Experiments described by the TOML files beside this one, and run by `bench/experiment.py`."""
