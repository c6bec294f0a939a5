"""Files that mean harm, or are none: one line each, in bounded time and memory, nothing given away."""

import os
import resource
import subprocess
import sys
import time

import numpy as np
import pytest

from calibration.curve.velocities import Column
from calibration.data import csv_file, read_csv, read_toml
from calibration.errors import InputError

HEADER = "velocity,restitution\n"
SECONDS = 10.0


def told(read, path):
    """The one line that a file is refused with, and that within the time."""
    start = time.process_time()
    with pytest.raises(InputError) as caught:
        read(path)
    assert time.process_time() - start < SECONDS
    assert str(caught.value).isprintable()
    return str(caught.value)


TOML = {
    "arrays": ("a = " + "[" * 3000 + "]" * 3000, "m.toml:1: nested too deeply; 50 brackets"),
    "inline tables": ("\na = " + "{a=" * 3000 + "1" + "}" * 3000, "m.toml:2: nested too deeply"),
    "a dotted key": (".".join(["a"] * 20_000) + " = 1", "m.toml:1: nested too deeply"),
    "a dotted header": ("[" + ".".join(["a"] * 20_000) + "]", "m.toml:1: nested too deeply"),
    "3 MB": ("#" * 3_000_000, "m.toml: is larger than 2 MiB"),
    "1 MB of keys": ("".join(f"a{i:05d} = 1\n" for i in range(80_000)), "unknown key 'a00000'"),
    "1 MB of tables": ("[[material]]\n" * 80_000, "m.toml:1: data is missing"),
    "1 MB of headers": ("".join(f"[a.b{i}]\n" for i in range(80_000)), "unknown key 'a'"),
    "1 MB of one text": ('a = """' + "\\n" * 500_000 + '"""', "unknown key 'a'"),
    "1 MB of one array": ("a = [" + "1,\n" * 330_000 + "]", "unknown key 'a'"),
    "1 MB of quotes": ('"""\\"' * 200_000, "m.toml:1: no valid TOML"),
    "1 MB of a number": (
        "[[material]]\ndensity = 0x" + "f" * 1_000_000,
        "m.toml:2: density is a wh",
    ),
}


@pytest.mark.parametrize("name", TOML)
def test_toml_that_would_exhaust_a_parser(name, tmp_path):
    text, line = TOML[name]
    (tmp_path / "m.toml").write_text(text)
    assert line in told(read_toml, tmp_path / "m.toml")


CSV = {
    "a cell of 20 MB": (HEADER + '1,"' + "a" * 20_000_000 + '"\n', "a.csv:2: 20000004 characters"),
    "a header without end": ("a," * 500_000, "a.csv:1: 1000000 characters in a line"),
    "20000 columns": ("," * 19_999 + "x\n", "a.csv:1: 20000 columns; 1000 are accepted"),
    "brackets in brackets": (
        "velocity (" + "(" * 5000 + ",e\n1,1\n",
        "a.csv:1: set of columns is restit",
    ),
    "blank lines": (HEADER + "\n" * 10_000_000, "a.csv:1: no rows of data"),
    "a NUL": (HEADER + "1,.5\n2,\0\n", "a.csv:3: a NUL character"),
    "70 MB": ("#" * 70_000_000, "a.csv: is larger than 64 MiB"),
}


@pytest.mark.parametrize("name", CSV)
def test_csv_that_would_exhaust_memory(name, tmp_path):
    text, line = CSV[name]
    (tmp_path / "a.csv").write_text(text)
    assert line in told(read_csv, tmp_path / "a.csv")


def test_rows_without_end(tmp_path, monkeypatch):
    monkeypatch.setattr(csv_file, "ROWS", 1000)
    (tmp_path / "a.csv").write_text(HEADER + "1,.5\n" * 1000)
    assert len(read_csv(tmp_path / "a.csv")) == 1000
    (tmp_path / "a.csv").write_text(HEADER + "1,.5\n" * 1001)
    assert "a.csv:1002: more than 1000 rows" in told(read_csv, tmp_path / "a.csv")


@pytest.mark.parametrize("read", [read_csv, read_toml])
def test_what_is_no_regular_file_is_not_opened(read, tmp_path):
    os.mkfifo(tmp_path / "pipe")  # nobody writes: to open it is to wait for ever
    for path in (tmp_path / "pipe", "/dev/zero", "/dev/tty"):
        if os.path.exists(path):
            assert f"{path}: is a device or a pipe; a file of text is needed" == told(read, path)
    assert "is a directory" in told(read, tmp_path)
    assert "cannot be read (no name of a file)" in told(read, "a\0b")
    assert "File name too long" in told(read, "x" * 300)
    (tmp_path / "ring").symlink_to(tmp_path / "ring")
    assert "cannot be read (Too many levels of symbolic links)" in told(read, tmp_path / "ring")


def test_velocities_from_a_device_that_has_no_lines():
    """A pipe is welcome there, and what comes without end is not held."""
    with pytest.raises(InputError, match="/dev/zero:1: more than 65536 characters in a line"):
        next(Column("/dev/zero").blocks())


@pytest.mark.skipif(os.geteuid() == 0, reason="root reads everything")
def test_what_may_not_be_read(tmp_path):
    (tmp_path / "a.csv").write_text(HEADER)
    (tmp_path / "a.csv").chmod(0)
    assert "cannot be read (Permission denied)" in told(read_csv, tmp_path / "a.csv")


def test_a_path_that_is_not_utf_8_is_told_by_its_codes(tmp_path):
    path = os.fsdecode(os.fsencode(tmp_path) + b"/st\xfc.csv")
    assert r"st\udcfc.csv: no such file" in told(read_csv, path)


SECRET = "tiger:x:0:0:woods\n"


@pytest.mark.parametrize("way", ["above", "absolute", "through a link"])
def test_a_file_elsewhere_is_named_and_not_quoted(way, tmp_path):
    (tmp_path / "secret").write_text(SECRET)
    home = tmp_path / "home"
    home.mkdir()
    (home / "link.csv").symlink_to(tmp_path / "secret")
    name = {"above": "../secret", "absolute": f"{tmp_path}/secret", "through a link": "link.csv"}
    (home / "m.toml").write_text(f'[[material]]\ndata = "{name[way]}"\n')
    line = told(read_toml, home / "m.toml")
    assert "secret:1: no header of measurements" in line or "link.csv:1: no header" in line
    assert "tiger" not in line
    # beside the file it is a slip, and quoted
    (home / "m.toml").write_text('[[material]]\ndata = "own.csv"\n')
    (home / "own.csv").write_text(SECRET)
    assert "own.csv:1: set of columns is 'tiger:x:0:0:woods'" in told(read_toml, home / "m.toml")


def test_a_material_file_reached_by_a_link_means_what_lies_beside_itself(tmp_path):
    for place, value in (("there", 0.9), ("here", 0.8)):
        (tmp_path / place).mkdir()
        (tmp_path / place / "a.csv").write_text(HEADER + f"1.0,{value}\n")
    (tmp_path / "there" / "m.toml").write_text('[[material]]\ndata = "a.csv"\n')
    (tmp_path / "here" / "m.toml").symlink_to(tmp_path / "there" / "m.toml")
    (data,) = read_toml(tmp_path / "here" / "m.toml")
    np.testing.assert_array_equal(data.restitution, [0.9])
    assert "there/a.csv' was found beside the file that the link points to" in data.remarks[0]
    (tmp_path / "there" / "a.csv").unlink()
    (data,) = read_toml(tmp_path / "here" / "m.toml")
    np.testing.assert_array_equal(data.restitution, [0.8])
    assert "here/a.csv' was found beside the link" in data.remarks[0]
    (tmp_path / "here" / "a.csv").unlink()
    line = told(read_toml, tmp_path / "here" / "m.toml")
    assert "m.toml:2: data file " in line
    assert "there/a.csv' or '" in line
    # a folder that is itself a link is no other place
    (tmp_path / "there" / "a.csv").write_text(HEADER + "1.0,0.7\n")
    (tmp_path / "door").symlink_to(tmp_path / "there")
    assert "was found" not in str(read_toml(tmp_path / "door" / "m.toml")[0].remarks)


READ_AND_TELL_THE_PEAK = """
import sys
from calibration.data import read_csv
data = read_csv(sys.argv[1])
status = open("/proc/self/status").read()
print(len(data), int(status.split("VmHWM:")[1].split()[0]) // 1024)
"""


@pytest.mark.skipif(not os.path.exists("/proc/self/status"), reason="tells the peak of memory")
@pytest.mark.parametrize("count", [100_000, pytest.param(1_000_000, marks=pytest.mark.long)])
def test_a_million_rows_within_ten_seconds_and_a_gibibyte(count, tmp_path):
    rng = np.random.default_rng(1)
    columns = rng.uniform(0.1, 0.9, (count, 2)).tolist()
    with open(tmp_path / "a.csv", "w") as file:
        file.write("velocity,restitution,uncertainty,group\n")
        file.writelines(f"{v:.6f},{e:.6f},0.003,s{i % 7}\n" for i, (v, e) in enumerate(columns))
    start = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [sys.executable, "-c", READ_AND_TELL_THE_PEAK, tmp_path / "a.csv"]
    out = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
    end = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert int(out[0]) == count
    assert int(out[1]) < 1024
    assert end.ru_utime - start.ru_utime < SECONDS + 3  # with the start of Python and JAX
