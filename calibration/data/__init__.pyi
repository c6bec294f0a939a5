# What type checkers and editors see of the names that are loaded when asked for.
from calibration.data.materials import read_problem as read_problem
from calibration.data.materials import read_toml as read_toml
from calibration.data.measurements import RestitutionData as RestitutionData
from calibration.data.plausible import Implausible as Implausible
from calibration.data.plausible import plausibility as plausibility
from calibration.data.point_errors import PointErrors as PointErrors
from calibration.data.sheet import read_csv as read_csv
