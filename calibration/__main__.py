"""`python -m calibration` is the command `softjax`."""

from calibration.cli import main

if __name__ == "__main__":
    raise SystemExit(main())
