"""Measurements as laboratories have them: read, checked, and with the errors that they share.

Each name is loaded when it is used: who reads a header or a table waits for no array library.
"""

from calibration.lazily import public

__getattr__, __dir__, __all__ = public(__name__)
