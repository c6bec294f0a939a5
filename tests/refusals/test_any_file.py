"""What is no file of text, or would exhaust the reader: one line."""

import os

import pytest

import calibration as cal

READERS = [cal.read_csv, cal.read_toml, cal.read_problem, cal.FitResult.load]


def said(read, path):
    with pytest.raises(cal.InputError) as caught:
        read(path)
    assert str(caught.value).replace("\n", "").isprintable()
    return str(caught.value)


@pytest.mark.parametrize("read", READERS)
def test_what_is_no_regular_file_is_not_opened(read, tmp_path):
    os.mkfifo(tmp_path / "pipe")  # nobody writes: to open it is to wait for ever
    for path in (tmp_path / "pipe", "/dev/zero"):
        assert said(read, path).startswith(f"{path}: is a device or a pipe; ")
    assert said(read, tmp_path).startswith(f"{tmp_path}: is a directory; ")
    missing = tmp_path / "missing"
    assert said(read, missing).startswith(f"{missing}: no such file; ")


@pytest.mark.skipif(os.geteuid() == 0, reason="root reads everything")
def test_what_may_not_be_read(tmp_path):
    (tmp_path / "a.csv").write_text("v,e\n1,0.9\n")
    (tmp_path / "a.csv").chmod(0)
    assert "Permission denied" in said(cal.read_csv, tmp_path / "a.csv")


def test_a_path_that_is_not_utf_8_is_told_by_its_codes(tmp_path):
    path = os.fsdecode(os.fsencode(tmp_path) + b"/st\xfc.csv")
    assert r"st\udcfc.csv: no such file" in said(cal.read_csv, path)


LARGE = {  # of at most 2 MiB, which a reader that looks at each key again for each would not end
    "keys": ("".join(f"a{i:05d} = 1\n" for i in range(20_000)), "m.toml:1: unknown key 'a00000'"),
    "tables": ("[[material]]\n" * 20_000, "m.toml:1: data is missing"),
    "text": ('a = """' + "\\n" * 500_000 + '"""', "m.toml:1: unknown key 'a'"),
    "array": ("a = [" + "1,\n" * 30_000 + "]", "m.toml:1: unknown key 'a'"),
    "quotes": ('"""\\"' * 200_000, "m.toml:1: "),
    "number": ("[[material]]\ndensity = 0x" + "f" * 100_000, "m.toml:2: density"),
}


@pytest.mark.parametrize("name", LARGE)
def test_large_material_files(name, tmp_path):
    text, words = LARGE[name]
    (tmp_path / "m.toml").write_text(text)
    assert words in said(cal.read_toml, tmp_path / "m.toml")
