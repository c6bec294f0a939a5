"""Measurements as laboratories have them: read, checked, and with the errors that they share.

Each name is loaded when it is asked for: who reads a header or a table waits for no array library.
"""

from calibration.lazily import loaded

_WHERE = {
    "Covariance": "covariance",
    "Implausible": "plausible",
    "MaterialFile": "toml_file",
    "PAPER_NOTE": "paper",
    "PointErrors": "errors_of_points",
    "RestitutionData": "measurements",
    "paper_materials": "paper",
    "plausibility": "plausible",
    "read_csv": "csv_file",
    "read_materials": "toml_file",
    "read_toml": "toml_file",
    "side_of_yield": "plausible",
}

__all__ = sorted(_WHERE)


def __getattr__(name: str):
    return loaded(__name__, _WHERE, name)
