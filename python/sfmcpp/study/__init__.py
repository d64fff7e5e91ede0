"""Runs measured: SLAM runs and reconstructions as reports and files; `evaluation`, `plotting`, `pages`."""

from sfmcpp.study.sfm_report import SfmReport
from sfmcpp.study.slam_report import SlamReport

__all__ = ["SfmReport", "SlamReport"]
