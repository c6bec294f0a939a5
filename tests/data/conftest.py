"""Files written into a folder of the test and read by the public names."""

import pytest

import calibration as cal


@pytest.fixture
def read(tmp_path):
    """A CSV file of this text, read by `cal.read_csv`."""

    def write_and_read(text, encoding="utf-8", **options):
        (tmp_path / "a.csv").write_bytes(text.encode(encoding))
        return cal.read_csv(tmp_path / "a.csv", **options)

    return write_and_read


@pytest.fixture
def read_toml(tmp_path):
    """A material file of this text beside `m.csv`, read by `cal.read_toml`."""

    def write_and_read(toml, csv="velocity,restitution\n1.0,0.9\n2.0,0.8\n", encoding="utf-8"):
        (tmp_path / "m.csv").write_text(csv, encoding="utf-8")
        (tmp_path / "m.toml").write_bytes(toml.encode(encoding))
        return cal.read_toml(tmp_path / "m.toml")

    return write_and_read
