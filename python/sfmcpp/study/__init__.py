"""Runs measured: SLAM runs as reports and files, trajectories (`evaluation`), pictures (`plotting`)."""

from sfmcpp.study.slam_report import SlamReport

__all__ = ["SlamReport"]
