"""Measurements as laboratories have them: read, checked, and with the errors that they share."""

from calibration.data.covariance import Covariance
from calibration.data.csv_file import read_csv
from calibration.data.errors_of_points import PointErrors
from calibration.data.measurements import RestitutionData
from calibration.data.paper import PAPER_NOTE, paper_materials
from calibration.data.plausible import Implausible, plausibility, side_of_yield
from calibration.data.toml_file import MaterialFile, read_materials, read_toml

__all__ = [
    "PAPER_NOTE",
    "Covariance",
    "Implausible",
    "MaterialFile",
    "PointErrors",
    "RestitutionData",
    "paper_materials",
    "plausibility",
    "read_csv",
    "read_materials",
    "read_toml",
    "side_of_yield",
]
