"""Calibration of contact laws from measured restitutions.

    import calibration as cal

    data = cal.RestitutionData(velocity, restitution, contact=pair)
    result = cal.fit(data)
    print(result)

Importing this imports no solver and no optimiser; each name is loaded when it is used.
"""

from calibration.lazily import public

__getattr__, __dir__, __all__ = public(__name__)
