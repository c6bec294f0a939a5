"""Files appear whole or not at all; progress is shown on a terminal and nowhere else."""

import io
import os

import pytest

from calibration.atomic import check_writable, files_into, replacing, write_text
from calibration.errors import InputError, NotWritten
from calibration.progress import Progress


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def write(directory, **texts) -> None:
    """Files `a.txt` and so on with these texts."""
    for name, text in texts.items():
        (directory / f"{name}.txt").write_text(text, encoding="utf-8")


def fail_after(context, **texts) -> None:
    """Write into what the context gives, then fail."""
    with context as staged:
        write(staged, **texts)
        raise ZeroDivisionError


def test_all_files_appear_together(tmp_path):
    out = tmp_path / "deep" / "results"
    with files_into(out) as staged:
        write(staged, a="a", b="b")
        assert not out.exists()
    assert {path.name: path.read_text(encoding="utf-8") for path in out.iterdir()} == {
        "a.txt": "a",
        "b.txt": "b",
    }
    assert [path.name for path in tmp_path.iterdir()] == ["deep"]  # nothing is left beside


def test_nothing_appears_where_one_file_fails(tmp_path):
    out = tmp_path / "results"
    with pytest.raises(ZeroDivisionError):
        fail_after(files_into(out), a="a")
    assert list(tmp_path.iterdir()) == []


def test_older_files_stay_as_they_were_where_one_fails(tmp_path):
    write(tmp_path, a="old")
    with pytest.raises(ZeroDivisionError):
        fail_after(files_into(tmp_path), a="new")
    assert (tmp_path / "a.txt").read_text(encoding="utf-8") == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]


def test_a_directory_in_a_files_place_stops_all_of_them(tmp_path):
    (tmp_path / "b.txt").mkdir()
    with pytest.raises(InputError, match=r"b\.txt"), files_into(tmp_path) as staged:
        write(staged, a="a", b="b")
    assert [path.name for path in tmp_path.iterdir()] == ["b.txt"]


def test_one_file_is_replaced_whole(tmp_path):
    path = tmp_path / "results" / "a.txt"
    with replacing(path) as staged:
        write_text(staged, "χ̃\n")
    assert path.read_bytes() == "χ̃\n".encode()
    with pytest.raises(ZeroDivisionError):
        _half_written(path)
    assert path.read_bytes() == "χ̃\n".encode()


def _half_written(path) -> None:
    with replacing(path) as staged:
        staged.write_text("half", encoding="utf-8")
        raise ZeroDivisionError


def test_a_place_that_cannot_be_written_to_is_refused(tmp_path):
    (tmp_path / "file").write_text("", encoding="utf-8")
    for path in (tmp_path / "file", tmp_path / "file" / "below" / "it"):
        with pytest.raises(InputError, match="is a file"):
            check_writable(path)
    check_writable(tmp_path / "not" / "yet" / "there")
    assert not (tmp_path / "not").exists()


def test_a_directory_without_permission_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "access", lambda path, mode: False)  # root may write anywhere
    with pytest.raises(NotWritten, match="no permission"):
        check_writable(tmp_path / "results")


def test_a_terminal_shows_one_bar_a_stage():
    terminal = Terminal()
    with Progress(file=terminal) as progress:
        for stage in ("first", "second"):
            for done in range(3):
                progress(stage, done, 2)
    shown = terminal.getvalue()
    assert "first" in shown
    assert "second" in shown
    assert "2/2" in shown


@pytest.mark.parametrize(("quiet", "file"), [(True, Terminal()), (False, io.StringIO())])
def test_nothing_is_shown_in_a_pipe_or_when_quiet(quiet, file):
    with Progress(quiet, file) as progress:
        progress("stage", 1, 2)
        assert list(progress.over(range(3), "items")) == [0, 1, 2]
    assert file.getvalue() == ""


def test_items_are_gone_through_with_a_bar():
    terminal = Terminal()
    with Progress(file=terminal) as progress:
        assert list(progress.over([3, 4], "items")) == [3, 4]
    assert "items" in terminal.getvalue()
