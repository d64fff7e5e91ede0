"""Diagnosis of a problem before or after a solve, and safe repairs."""

from sfmcpp.doctor.diagnose import diagnose
from sfmcpp.doctor.finding import SEVERITIES, Diagnosis, Finding
from sfmcpp.doctor.repair import Repair, repair

__all__ = ["SEVERITIES", "Diagnosis", "Finding", "Repair", "diagnose", "repair"]
